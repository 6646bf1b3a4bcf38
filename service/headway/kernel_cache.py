"""The folder of compiled kernels, which one process at a time fills."""

import fcntl
import gc
import glob
import hashlib
import json
import os
import pickletools
import sys
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from io import BytesIO
from pathlib import Path

LOCK = "lock"
CHECKSUMS = "checksums.json"

_PACKAGE = Path(__file__).parent


def core_digest(package: Path = _PACKAGE) -> str:
    """Return twelve hexadecimal digits that differ when any source of the core differs."""
    return _digest(_core(package))


def kernels_digest(package: Path = _PACKAGE) -> str:
    """Return twelve hexadecimal digits that differ when any source with a compiled kernel differs."""
    beside = (package / "edge" / "codec" / "msgpack_columns.py", package / "feeds" / "uper_kernel.py")
    return _digest([*_core(package), *beside])


def use() -> None:
    """Name the folder to numba, which must know it before it is imported; variables that are set already win.

    numba keys a cached kernel by its own file only and would use it after a change of its callees in other files. So
    the digest of all these files names the folder.
    """
    os.environ.setdefault("NUMBA_CACHE_DIR", str(_PACKAGE / "__pycache__" / f"kernels-{kernels_digest()}"))
    # Vector instructions for equal operations beside each other: the same bits, and a filter takes a tenth less time.
    os.environ.setdefault("NUMBA_SLP_VECTORIZE", "1")


def _core(package: Path) -> list[Path]:
    return list((package / "core").rglob("*.py"))


def _digest(sources: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


def without_blas() -> None:
    """Keep numba from loading SciPy for linear algebra, 15 MB, in a process whose kernels use none."""
    sys.modules.setdefault("scipy.linalg", None)  # type: ignore[arg-type]  # the import fails, as numba allows


def release_bitcode() -> None:
    """Free the bitcode of the loaded kernels, 10 MB: a kernel that is compiled later calls them and inlines nothing."""
    from llvmlite import binding  # noqa: PLC0415 - `use` comes before numba
    from numba.core.codegen import CPUCodeLibrary  # noqa: PLC0415

    nothing = binding.parse_assembly("")
    for found in gc.get_objects():
        if issubclass(type(found), CPUCodeLibrary):
            found._shared_module = nothing  # noqa: SLF001 - there is no other way


@contextmanager
def alone() -> Iterator[None]:
    """Wait until no other process compiles into the folder, and keep others waiting.

    numba numbers its files without regard to other processes. Of two processes that compile one kernel for rows of
    different delays, the second overwrites the file that the index gives for the first, which then runs code for other
    rows. If the folder is read-only there is no lock, because no process fills it.

    Damaged files are removed first, so that their kernels are compiled again: numba raises on a file that is cut short,
    and machine code with a wrong bit ends the process.
    """
    folder = _folder()
    is_noted = False
    with ExitStack() as held:
        with suppress(OSError):
            folder.mkdir(parents=True, exist_ok=True)
            lock = held.enter_context((folder / LOCK).open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
            is_noted = _remove_damaged(folder)
        count = kept()
        yield
        if is_noted and kept() == count:
            return
        with suppress(OSError):
            (folder / CHECKSUMS).write_text(json.dumps(_checksums(folder)), encoding="utf-8")


def _remove_damaged(folder: Path) -> bool:
    """Remove a kernel of which a file is not as it was noted, or is not noted and cannot be read.

    Return whether all files were as noted.
    """
    try:
        noted = dict(json.loads((folder / CHECKSUMS).read_text(encoding="utf-8")))
    except (OSError, ValueError, TypeError):
        noted = {}
    found = _checksums(folder)
    for name, checksum in found.items():
        if not (folder / name).exists():  # removed with another file of its kernel
            continue
        if not (noted[name] == checksum if name in noted else _is_readable(folder / name)):
            file = folder / name
            kernel, _, _ = file.name.partition(".py")
            for part in file.parent.glob(f"{glob.escape(kernel)}.py*"):
                part.unlink()
    return noted == found


def _checksums(folder: Path) -> dict[str, str]:
    files = [file for ending in ("nbi", "nbc") for file in folder.rglob(f"*.{ending}")]
    return {str(file.relative_to(folder)): hashlib.sha256(file.read_bytes()).hexdigest() for file in files}


def _is_readable(file: Path) -> bool:
    """Whether the file is as long as numba wrote it: a pickle ends with its own mark."""
    try:
        content = BytesIO(file.read_bytes())
        while content.tell() < content.getbuffer().nbytes:
            for _ in pickletools.genops(content):
                pass
    except ValueError:
        return False
    return content.tell() > 0


def kept() -> int:
    """Return the number of compiled kernels in the folder."""
    return sum(1 for _ in _folder().rglob("*.nbc"))


def _folder() -> Path:
    return Path(os.environ["NUMBA_CACHE_DIR"])
