"""Offline evaluation: the one part of the load generator that runs the service's own core."""
