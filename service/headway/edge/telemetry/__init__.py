"""Accounts, metrics, health and logs of this process."""
