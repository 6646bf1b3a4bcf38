"""headway: which reading, of which sensor, of which car, cannot be true."""
