"""Bytes to columns, and the messages of the service to bytes."""
