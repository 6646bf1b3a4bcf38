"""Rows of memory and compiled calls."""
