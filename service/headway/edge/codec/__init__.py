"""Bytes to columns, and the service's own messages to bytes."""
