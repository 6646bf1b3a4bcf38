"""The pure core: arrays and frozen values in, outcomes out. No clock, no I/O, no logging, no settings."""
