"""What the detector knows, on disk: a service that is started again goes on with the vehicles it knew.

The state is copied a slice in each turn, so that no turn takes long, and written by a thread of its own. The file holds
lines of JSON and the tables as they are in memory: only the same core in the same configuration reads it.
"""

import json
import os
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog
from numpy.typing import NDArray

from headway.core.engine import Engine
from headway.core.snapshot import OpenEvent, OpenMiss, Snapshot, whole
from headway.edge.clock import Clock
from headway.edge.outbox import Outbox
from headway.edge.vitals import Identity

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
        self._parts: list[Snapshot] = []
        self._outbox = Outbox("headway-snapshot", 1, OSError)
        self.written = 0
        self.failed = 0
        self.trouble: str | None = None
        """Why the newest snapshot could not be written."""

    def turn(self, now_ns: int) -> None:
        """Copy the next slice when a snapshot is due; the last one has it written."""
        if now_ns < self._due_ns:
            return
        self._parts.append(self._engine.snapshot(_SLICES, len(self._parts)))
        if len(self._parts) == _SLICES:
            parts, self._parts = self._parts, []
            self._due_ns = now_ns + self._interval_ns
            self._outbox.put(lambda: self._write(parts))

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
        """Write what is known now."""
        last = self._engine.snapshot()
        self._outbox.put(lambda: self._write([last]))
        self._outbox.close(_CLOSE_S)

    def _write(self, parts: list[Snapshot]) -> None:
        try:
            _write(self._path, self._maker(), parts)
        except OSError as error:
            self.failed += 1
            if self.trouble is None:
                _log.error("snapshot cannot be written", file=str(self._path), error=str(error))
            self.trouble = error.strerror or str(error)
        else:
            self.written += 1
            self.trouble = None

    def _maker(self) -> dict[str, float | str]:
        """Return what must be the same for a snapshot to fit."""
        identity = self._identity
        return {"format": _FORMAT, "site": identity.site, "byteorder": sys.byteorder, **identity.parameters}


def _write(path: Path, maker: dict[str, float | str], parts: Sequence[Snapshot]) -> None:
    """Replace the file, so that there is a whole one at any time.

    Part by part and without copies: the loop is held up by as much as this thread does in one piece.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(path.name + ".new")
    checksum = 0
    with fresh.open("wb") as file:
        for chunk in _chunks(maker, parts):
            checksum = zlib.crc32(chunk, checksum)
            file.write(chunk)
        file.write(b"%08x" % checksum)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)


def _chunks(maker: dict[str, float | str], parts: Sequence[Snapshot]) -> Iterator[bytes | memoryview]:
    yield json.dumps({"maker": maker, "parts": len(parts)}).encode() + b"\n"
    for part in parts:
        beside = {name: getattr(part, name) for name in ("ids", "events", "link_events", "misses")}
        yield json.dumps({"rows": part.rows.tolist(), **beside}).encode() + b"\n"
        for table in part.tables.values():
            yield table.view(np.uint8).data


def _read(path: Path, maker: dict[str, float | str], tables: Mapping[str, NDArray[Any]]) -> Snapshot:
    """Read what `_write` wrote; `tables` show the types. Raises `OSError`, or `ValueError` where it does not fit."""
    content = path.read_bytes()
    if content[-_CHECKSUM:] != b"%08x" % zlib.crc32(memoryview(content)[:-_CHECKSUM]):
        raise ValueError("damaged")
    file = BytesIO(content)
    header = json.loads(file.readline())
    other = sorted(name for name in maker.keys() | header["maker"] if maker.get(name) != header["maker"].get(name))
    if other:
        raise ValueError(f"made with another {', '.join(other)}")
    return whole([_read_part(file, tables) for _ in range(header["parts"])])


def _read_part(file: BytesIO, tables: Mapping[str, NDArray[Any]]) -> Snapshot:
    beside = json.loads(file.readline())
    rows = np.array(beside["rows"], np.int64)
    return Snapshot(
        rows=rows,
        ids=beside["ids"],
        tables={name: np.frombuffer(file.read(rows.size * t.itemsize), t.dtype) for name, t in tables.items()},
        events=[OpenEvent(*event) for event in beside["events"]],
        link_events=[OpenEvent(*event) for event in beside["link_events"]],
        misses=[OpenMiss(*miss) for miss in beside["misses"]],
    )
