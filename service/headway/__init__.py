"""headway: which reading, of which sensor, of which car, cannot be true."""

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

_HERE = Path(__file__).parent


def core_digest() -> str:
    """Return twelve hexadecimal digits that differ when any source of the core differs."""
    return _digest((_HERE / "core").glob("*.py"))


def _digest(sources: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for source in sorted(sources):
        digest.update(source.read_bytes())
    return digest.hexdigest()[:12]


# numba keys a cached kernel by its own file alone and would go on using one whose callees in other files have changed.
_KERNELS = _digest([*(_HERE / "core").glob("*.py"), _HERE / "edge" / "compact.py"])
os.environ.setdefault("NUMBA_CACHE_DIR", str(_HERE / "__pycache__" / f"kernels-{_KERNELS}"))
