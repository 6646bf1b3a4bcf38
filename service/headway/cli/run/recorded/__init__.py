"""Recordings for the commands: what is read, refused and reported."""
