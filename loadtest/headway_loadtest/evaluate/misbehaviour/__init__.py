"""Senders whose readings agree with each other and are wrong."""
