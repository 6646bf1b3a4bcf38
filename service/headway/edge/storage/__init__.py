"""Journal and snapshots on disk."""
