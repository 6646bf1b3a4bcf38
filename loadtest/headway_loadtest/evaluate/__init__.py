"""Offline evaluation: the one part of the load generator that runs the service's own core."""

# First of all imports: it names the cache of compiled kernels, which numba reads once, when it is imported itself.
import headway.core  # noqa: F401
