"""Recordings of messages: JSON, XER and captured packets."""
