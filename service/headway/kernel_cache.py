"""The folder of compiled kernels, which one process at a time fills."""

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
    beside = (package / "edge" / "codec" / "msgpack_columns.py", package / "feeds" / "uper_kernel.py")
    return _digest([*_core(package), *beside])


def use() -> None:
    """Name the folder to numba, which must know it before it is imported; NUMBA_CACHE_DIR wins.

    numba keys a cached kernel by its own file only and would use it after a change of its callees in other files. So
    the digest of all these files names the folder.
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
    """Wait until no other process compiles into the folder, and keep others waiting.

    numba numbers its files without regard to other processes. Of two processes that compile one kernel for rows of
    different delays, the second overwrites the file that the index gives for the first, which then runs code for other
    rows. If the folder is read-only there is no lock, because no process fills it.
    """
    folder = _folder()
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            lock = held.enter_context((folder / LOCK).open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def kept() -> int:
    """Return the number of compiled kernels in the folder."""
    return sum(1 for _ in _folder().rglob("*.nbc"))


def _folder() -> Path:
    return Path(os.environ["NUMBA_CACHE_DIR"])
