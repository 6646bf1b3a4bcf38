"""A gateway as a process of its own."""
