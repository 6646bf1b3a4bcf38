"""Faults put into drives, with their labels."""
