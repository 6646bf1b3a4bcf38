"""A stored verdict computed again, number by number."""
