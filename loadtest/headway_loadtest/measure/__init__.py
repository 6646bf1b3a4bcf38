"""What a run came to: accounts, latency, detection."""
