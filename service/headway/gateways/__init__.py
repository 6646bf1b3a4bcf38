"""Other feeds and the bus: processes that put what they receive; recordings as records."""
