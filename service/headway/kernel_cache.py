"""The folder where numba keeps compiled kernels, filled by one process at a time."""

import fcntl
import hashlib
import os
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

LOCK = "lock"

_PACKAGE = Path(__file__).parent


def core_digest(package: Path = _PACKAGE) -> str:
    """Return twelve hexadecimal digits that differ when any source of the core differs."""
    return _digest(_core(package))


def kernels_digest(package: Path = _PACKAGE) -> str:
    """Return twelve hexadecimal digits that differ when any source with a compiled kernel differs."""
    return _digest([*_core(package), package / "edge" / "codec" / "msgpack_columns.py"])


def use() -> None:
    """Name the folder to numba, which must know it before it is imported; NUMBA_CACHE_DIR wins.

    numba keys a cached kernel by its own file alone. It would go on using one whose callees in other files have
    changed, so the folder is named by the digest of them all.
    """
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_PACKAGE / "__pycache__" / f"kernels-{kernels_digest()}"))


def _core(package: Path) -> list[Path]:
    return list((package / "core").rglob("*.py"))


def _digest(sources: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


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
