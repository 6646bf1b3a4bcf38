"""The version of headway."""

from importlib import metadata


def version() -> str:
    """Return the version of the installed distribution."""
    try:
        return metadata.version("headway")
    except metadata.PackageNotFoundError:
        return "in place"
