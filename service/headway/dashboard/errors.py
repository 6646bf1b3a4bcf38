class DashboardError(Exception):
    """What keeps a view from starting and what to do about it, in one line."""
