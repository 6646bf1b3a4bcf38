"""Tests between two vehicles, and the attribution of a contradiction to one of them."""
