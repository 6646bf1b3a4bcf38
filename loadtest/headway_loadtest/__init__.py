"""The load generator: replays drives over the wire with labelled anomalies, and judges what comes back."""
