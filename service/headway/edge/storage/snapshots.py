"""The state of the detector on disk, so that a restarted service continues with the vehicles that it knew.

The state is copied a slice at a time, so that no loop iteration takes long. A thread writes each slice before the next
one is copied, so that no second copy of the whole state exists. The file holds lines of JSON and the tables as they are
in memory: only the same core in the same configuration reads it.
"""

import json
import os
import sys
import zlib
from collections.abc import Generator, Iterator, Mapping
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog
from numpy.typing import NDArray

from headway.core.engine import Engine
from headway.core.types.snapshot import OpenEvent, OpenMiss, Snapshot, concatenate
from headway.edge.clock import Clock
from headway.edge.identity import Identity
from headway.edge.worker import Worker

_SLICES: Final = 64
_CLOSE_S: Final = 5.0
_FORMAT: Final = 1
_CHECKSUM: Final = 8
"""Hexadecimal digits at the end of the file."""

_log: Final = structlog.get_logger(__name__)


class Snapshots:
    """Takes a snapshot of an engine every `interval_s`, and one at the end.

    Parameters
    ----------
    path
        The file; each snapshot replaces it as a whole.
    interval_s
        Time between two snapshots.
    """

    def __init__(self, path: Path, interval_s: float, engine: Engine, identity: Identity, clock: Clock) -> None:
        self._path = path
        self._interval_ns = int(interval_s * 1e9)
        self._engine = engine
        self._identity = identity
        self._clock = clock
        self._due_ns = clock.monotonic_ns() + self._interval_ns
        self._slice = 0
        self._file: _Writing | None = None
        self._worker = Worker("headway-snapshot", _SLICES, OSError)
        self.written = 0
        self.failed = 0
        self.trouble: str | None = None
        """Why the newest snapshot could not be written."""

    def tick(self, now_ns: int) -> None:
        """Copy the next slice if a snapshot is due and the slice before is written."""
        if now_ns < self._due_ns or self._worker.waiting:
            return
        place, self._slice = self._slice, (self._slice + 1) % _SLICES
        part = self._engine.snapshot(_SLICES, place)
        if self._slice == 0:
            self._due_ns = now_ns + self._interval_ns
        self._worker.put(lambda: self._write(place, part))

    def load(self) -> int:
        """Restore the engine from the file if it fits; return the number of vehicles restored."""
        try:
            snapshot = _read(self._path, self._maker(), self._engine.snapshot().tables)
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            _log.warning("snapshot not used; all vehicles warm up again", file=str(self._path), reason=str(error))
            return 0
        vehicles = self._engine.restore(snapshot, self._clock.local_us())
        _log.info("snapshot loaded", vehicles=vehicles, of=len(snapshot.ids))
        return vehicles

    def close(self) -> None:
        """Write a last snapshot; the engine must not step meanwhile."""
        self._worker.put(self._write_all)
        self._worker.close(_CLOSE_S)

    def _write_all(self) -> None:
        for place in range(_SLICES):
            self._write(place, self._engine.snapshot(_SLICES, place))

    def _write(self, place: int, part: Snapshot) -> None:
        """Write a slice. The first one starts a file; after a failure nothing is written until the next first one."""
        try:
            if place == 0:
                self._file = _writing(self._path, self._maker())
                next(self._file)
            if self._file is not None:
                self._file.send(part)
        except StopIteration:
            self.written += 1
            self.trouble = None
        except OSError as error:
            self._file = None
            self.failed += 1
            if self.trouble is None:
                _log.error("snapshot cannot be written", file=str(self._path), error=str(error))
            self.trouble = error.strerror or str(error)

    def _maker(self) -> dict[str, float | str]:
        """Return what must be equal for a snapshot to fit."""
        identity = self._identity
        return {"format": _FORMAT, "site": identity.site, "byteorder": sys.byteorder, **identity.parameters}


_Writing = Generator[None, Snapshot, None]


def _writing(path: Path, maker: dict[str, float | str]) -> _Writing:
    """Receive all slices and replace the file after the last one: a whole file exists at any time.

    The chunks are not copied, because the interpreter lock holds up the loop during a copy.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(path.name + ".new")
    with fresh.open("wb") as file:
        header = json.dumps({"maker": maker, "parts": _SLICES}).encode() + b"\n"
        checksum = zlib.crc32(header)
        file.write(header)
        for _ in range(_SLICES):
            for chunk in _chunks((yield)):
                checksum = zlib.crc32(chunk, checksum)
                file.write(chunk)
        file.write(b"%08x" % checksum)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)


def _chunks(part: Snapshot) -> Iterator[bytes | memoryview]:
    beside = {name: getattr(part, name) for name in ("ids", "events", "pair_events", "misses")}
    yield json.dumps({"rows": part.rows.tolist(), **beside}).encode() + b"\n"
    for table in part.tables.values():
        yield table.view(np.uint8).data


def _read(path: Path, maker: dict[str, float | str], tables: Mapping[str, NDArray[Any]]) -> Snapshot:
    """Read what `_writing` wrote; `tables` show the types. Raises `OSError`, or `ValueError` where it does not fit."""
    content = path.read_bytes()
    if content[-_CHECKSUM:] != b"%08x" % zlib.crc32(memoryview(content)[:-_CHECKSUM]):
        raise ValueError("damaged")
    file = BytesIO(content)
    header = json.loads(file.readline())
    other = sorted(name for name in maker.keys() | header["maker"] if maker.get(name) != header["maker"].get(name))
    if other:
        raise ValueError(f"made with another {', '.join(other)}")
    return concatenate([_read_part(file, tables) for _ in range(header["parts"])])


def _read_part(file: BytesIO, tables: Mapping[str, NDArray[Any]]) -> Snapshot:
    beside = json.loads(file.readline())
    rows = np.array(beside["rows"], np.int64)
    return Snapshot(
        rows=rows,
        ids=beside["ids"],
        tables={name: np.frombuffer(file.read(rows.size * t.itemsize), t.dtype) for name, t in tables.items()},
        events=[OpenEvent(*event) for event in beside["events"]],
        pair_events=[OpenEvent(*event) for event in beside["pair_events"]],
        misses=[OpenMiss(*miss) for miss in beside["misses"]],
    )
