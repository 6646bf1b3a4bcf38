"""What the detector knows, on disk: a service that is started again goes on with the vehicles it knew.

The state is copied a slice at a time, so that no turn takes long, and each slice is written by a thread of its own
before the next is copied, so that there is never a second copy of it all. The file holds lines of JSON and the tables
as they are in memory: only the same core in the same configuration reads it.
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
from headway.edge.worker import Outbox

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
        The file, which is replaced as a whole.
    interval_s
        From one to the next.
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
        self._outbox = Outbox("headway-snapshot", _SLICES, OSError)
        self.written = 0
        self.failed = 0
        self.trouble: str | None = None
        """Why the newest snapshot could not be written."""

    def turn(self, now_ns: int) -> None:
        """Copy the next slice when a snapshot is due and the slice before is written."""
        if now_ns < self._due_ns or self._outbox.waiting:
            return
        place, self._slice = self._slice, (self._slice + 1) % _SLICES
        part = self._engine.snapshot(_SLICES, place)
        if self._slice == 0:
            self._due_ns = now_ns + self._interval_ns
        self._outbox.put(lambda: self._write(place, part))

    def load(self) -> int:
        """Let the engine go on with what the file says, if it fits; return how many vehicles it knows then."""
        try:
            snapshot = _read(self._path, self._maker(), self._engine.snapshot().tables)
        except FileNotFoundError:
            return 0
        except (OSError, ValueError) as error:
            _log.warning("snapshot not used; every vehicle begins anew", file=str(self._path), reason=str(error))
            return 0
        vehicles = self._engine.restore(snapshot, self._clock.wall_us())
        _log.info("snapshot loaded", vehicles=vehicles, of=len(snapshot.ids))
        return vehicles

    def close(self) -> None:
        """Write what is known now; the engine must stand still meanwhile."""
        self._outbox.put(self._write_all)
        self._outbox.close(_CLOSE_S)

    def _write_all(self) -> None:
        for place in range(_SLICES):
            self._write(place, self._engine.snapshot(_SLICES, place))

    def _write(self, place: int, part: Snapshot) -> None:
        """Write a slice; the first one begins a file, and what fails is over until then."""
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
        """Return what must be the same for a snapshot to fit."""
        identity = self._identity
        return {"format": _FORMAT, "site": identity.site, "byteorder": sys.byteorder, **identity.parameters}


_Writing = Generator[None, Snapshot, None]


def _writing(path: Path, maker: dict[str, float | str]) -> _Writing:
    """Take slices, as many as there are, and replace the file after the last: there is a whole one at any time.

    Without copies: the loop is held up by as much as this thread does in one piece.
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
