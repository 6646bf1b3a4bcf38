"""The folder where numba keeps compiled kernels, filled by one process at a time."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

LOCK = "lock"


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process compiles into the folder, and keep others waiting meanwhile.

    numba numbers what it keeps without a look at other processes: of two that compile one kernel for rows of different
    delays, the second overwrites what the index promises for the first, and whoever loads that runs code for other
    rows. A folder that cannot be written is not filled either, and nobody waits.
    """
    folder = _folder()
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            lock = held.enter_context((folder / LOCK).open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def kept() -> int:
    """Return how many compiled kernels the folder holds."""
    return sum(1 for _ in _folder().rglob("*.nbc"))


def _folder() -> Path:
    return Path(os.environ["NUMBA_CACHE_DIR"])
