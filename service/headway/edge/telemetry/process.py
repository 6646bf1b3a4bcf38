"""Figures of the operating system about this process."""

import os
from pathlib import Path


def rss_mb() -> float | None:
    """Return the resident memory of this process, None where the system has no /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6
