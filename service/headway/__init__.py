"""headway: which reading, of which sensor, of which car, cannot be true."""

from headway import kernel_cache

kernel_cache.use()
