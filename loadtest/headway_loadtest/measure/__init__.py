"""The result of a run: accounting, latency, detection."""
