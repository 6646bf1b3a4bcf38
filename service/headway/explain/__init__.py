"""A stored verdict computed again, value by value."""
