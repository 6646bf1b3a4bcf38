"""Figures of the operating system about this process."""

import ctypes
import mmap
import os
import re
from pathlib import Path
from typing import Final

_MAPPING: Final = re.compile(r"(?P<start>[0-9a-f]+)-(?P<end>[0-9a-f]+) (?P<access>\S+) \S+ \S+ \d+\s*(?P<path>.*)")
"""The first line of a mapping in smaps."""


def rss_mb() -> float | None:
    """Return the resident memory of this process, None where the system has no /proc."""
    try:
        pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
    except OSError:
        return None
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def release_pages() -> None:
    """Give the unchanged pages of libraries and other files back to the system, which reads those again that are used.

    Changed pages stay. Without Linux nothing is done.
    """
    maps = Path("/proc/self/smaps")
    if not maps.exists():
        return
    madvise = ctypes.CDLL(None).madvise
    madvise.argtypes = (ctypes.c_void_p, ctypes.c_size_t, ctypes.c_int)
    start = end = 0
    for line in maps.read_text(encoding="utf-8").splitlines():
        if mapping := _MAPPING.match(line):
            is_file = mapping["path"].startswith("/") and not mapping["path"].startswith("/dev/")
            is_released = is_file and "w" not in mapping["access"]
            start, end = (int(mapping["start"], 16), int(mapping["end"], 16)) if is_released else (0, 0)
        elif start and line.split() == ["Anonymous:", "0", "kB"]:
            madvise(start, end - start, mmap.MADV_DONTNEED)
