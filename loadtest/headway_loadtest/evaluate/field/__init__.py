"""Recordings of real senders and simulated traffic through the service's own engine: `headway evaluate field`."""
