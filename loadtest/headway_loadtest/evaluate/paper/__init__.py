"""The published experiment."""
