"""Recordings: files and standard input as BSM v1 records in the order of reception."""
