"""The state of the detector on disk, so that a restarted service continues with the vehicles that it knew.

A snapshot has a file for each 64th of the rows. The loop copies a part at a time, so that no iteration takes long, and
a thread writes it before the next one is copied. Where iterations are longer than the time between two parts, one
copies up to four small parts, so that a snapshot is no older on a busy machine. A part that has not changed is not
written again. The snapshot is for a process that ended, not for a machine that did. So nothing is synchronised before
the last one, and the system writes each file to the disk every half a minute at most. A part that is torn or damaged is
left out.

A part is a line of JSON, the tables as they are in memory without the words that are zero, and a checksum. Only the
same core in the same configuration reads it.
"""

import json
import math
import os
import sys
import zlib
from collections.abc import Mapping
from functools import reduce
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
from headway.edge.storage.packed import packed, unpacked
from headway.edge.worker import Worker

_PARTS: Final = 64
_ENDS: Final = (0, _PARTS - 1)
"""Parts at which a snapshot begins and ends, for its account."""
_FIRST_NS: Final = 200_000_000
"""The first snapshot begins so long after the start: a service that is killed soon again has a new one."""
_AT_ONCE, _VEHICLES_AT_ONCE = 4, 64
"""Most parts that one iteration copies, and the number of vehicles that ends it."""
_VEHICLE_NS: Final = 100_000
"""Least time for each vehicle of a part, so that the share of the processor is bounded: 20,000 vehicles take 2 s."""
_CLOSE_S: Final = 5.0
_FORMAT: Final = 3
_CHECKSUM: Final = 8
"""Hexadecimal digits at the end of a file."""

_log: Final = structlog.get_logger(__name__)


class Snapshots:
    """Takes a snapshot of an engine every `interval_s`, part by part, and one at the end.

    Parameters
    ----------
    folder
        Where the parts are; it is made when the first is written.
    interval_s
        Time between two copies of a part.
    """

    def __init__(self, folder: Path, interval_s: float, engine: Engine, identity: Identity, clock: Clock) -> None:
        self._folder = folder
        self._interval_ns = int(interval_s * 1e9)
        self._engine = engine
        self._identity = identity
        self._clock = clock
        self._due_ns = clock.monotonic_ns() + min(_FIRST_NS, self._interval_ns)
        self._part = 0
        self._is_empty = [False] * _PARTS
        """Whether the file of a part has no vehicle."""
        self._checksums: dict[int, int] = {}
        self._worker = Worker("headway-snapshot", _PARTS, OSError)
        self._is_whole = True
        self.newest_us = 0
        """Unix time of the newest message in the snapshot that was loaded; 0: none."""
        self.written = 0
        self.failed = 0
        self.trouble: str | None = None
        """Why the newest snapshot could not be written."""

    @property
    def due_ns(self) -> float:
        """Monotonic time of the next part; infinite: all parts are empty, and written so."""
        return math.inf if all(self._is_empty) and not self._engine.vehicles else self._due_ns

    def tick(self, now_ns: int) -> None:
        """Copy the parts that are due, if those before are written."""
        if now_ns < self.due_ns or self._worker.waiting:
            return
        part_ns, parts, vehicles = self._interval_ns // _PARTS, 0, 0
        self._due_ns = max(self._due_ns, now_ns - _AT_ONCE * part_ns)
        while now_ns >= self._due_ns and parts < _AT_ONCE and vehicles < _VEHICLES_AT_ONCE:
            copied = self._copy()
            parts, vehicles = parts + 1, vehicles + copied
            self._due_ns += max(part_ns, copied * _VEHICLE_NS)

    def _copy(self) -> int:
        """Copy the next part and queue it to be written; return how many vehicles it has."""
        place, self._part = self._part, (self._part + 1) % _PARTS
        if self._is_empty[place] and place not in _ENDS and self._engine.is_empty(_PARTS, place):
            return 0
        part = self._engine.snapshot(_PARTS, place)
        offset_us = self._clock.wall_us() - self._clock.local_us()
        self._worker.put(lambda: self._write(place, part, offset_us))
        return len(part.ids)

    def load(self) -> int:
        """Restore the engine from the files that fit; return the number of vehicles restored."""
        parts, reasons = [], set()
        tables = self._engine.snapshot().tables
        for file in sorted(self._folder.glob("*.part")):
            try:
                parts.append(_read(file, self._maker(), tables))
            except (OSError, ValueError, KeyError, TypeError) as error:
                reasons.add(str(error))
        if reasons:
            _log.warning(
                "snapshot not used, or not all of it; these vehicles warm up again",
                folder=str(self._folder), reason="; ".join(sorted(reasons)),
            )  # fmt: skip
        if not parts:
            return 0
        snapshot = concatenate(parts)
        self.newest_us = int(snapshot.tables["tracks"]["received_us"].max(initial=0))
        vehicles = self._engine.restore(snapshot, self._clock.local_us())
        _log.info("snapshot loaded", vehicles=vehicles, of=len(snapshot.ids))
        return vehicles

    def close(self, *, sync: bool = True) -> None:
        """Write a last snapshot, to the disk with `sync`; the engine must not step meanwhile."""
        self._worker.put(lambda: self._write_all(sync=sync))
        self._worker.close(_CLOSE_S)

    def _write_all(self, *, sync: bool) -> None:
        offset_us = self._clock.wall_us() - self._clock.local_us()
        for place in range(_PARTS):
            self._write(place, self._engine.snapshot(_PARTS, place), offset_us, last=sync)

    def _write(self, place: int, part: Snapshot, offset_us: int, *, last: bool = False) -> None:
        """Write a part over the one before, in one call."""
        if place == 0:
            self._is_whole = True
        try:
            content = _content(part, offset_us, self._maker())
            checksum = reduce(lambda of, piece: zlib.crc32(piece, of), content, 0)
            if last or self._checksums.get(place) != checksum:
                self._folder.mkdir(parents=True, exist_ok=True, mode=0o700)
                _overwrite(self._folder / f"{place:02}.part", [*content, b"%08x" % checksum], sync=last)
                self._checksums[place] = checksum
            self._is_empty[place] = not part.ids
        except OSError as error:
            self._is_whole = False
            self.failed += 1
            if self.trouble is None:
                _log.error("snapshot cannot be written", folder=str(self._folder), error=str(error))
            self.trouble = error.strerror or str(error)
        if place == _PARTS - 1 and self._is_whole:
            self.written += 1
            self.trouble = None

    def _maker(self) -> dict[str, float | str]:
        """Return what must be equal for a snapshot to fit."""
        identity = self._identity
        return {"format": _FORMAT, "site": identity.site, "byteorder": sys.byteorder, **identity.parameters}


def _overwrite(path: Path, content: list[bytes | memoryview], *, sync: bool) -> None:
    """Write the file in place, in one call: a new file would go to the disk each time."""
    file = os.open(path, os.O_WRONLY | os.O_CREAT, 0o600)
    try:
        os.ftruncate(file, os.pwritev(file, content, 0))
        if sync:
            os.fsync(file)
    finally:
        os.close(file)


def _content(part: Snapshot, offset_us: int, maker: dict[str, float | str]) -> list[bytes | memoryview]:
    """Return the pieces of a part: a line of JSON, then of each table which words are not zero, and these."""
    header = {name: getattr(part, name) for name in ("ids", "events", "pair_events", "misses")}
    header |= {"maker": maker, "clock_offset_us": round(offset_us, -3), "rows": part.rows.tolist()}
    return [json.dumps(header).encode() + b"\n", *(piece for table in part.tables.values() for piece in packed(table))]


def _read(path: Path, maker: dict[str, float | str], tables: Mapping[str, NDArray[Any]]) -> Snapshot:
    """Read what `_content` wrote, its times as Unix time; `tables` show the types.

    Raises `OSError`, and others where the file does not fit.
    """
    content = path.read_bytes()
    if content[-_CHECKSUM:] != b"%08x" % zlib.crc32(memoryview(content)[:-_CHECKSUM]):
        raise ValueError("damaged")
    file = BytesIO(content)
    header = json.loads(file.readline())
    other = sorted(name for name in maker.keys() | header["maker"] if maker.get(name) != header["maker"].get(name))
    if other:
        raise ValueError(f"made with another {', '.join(other)}")
    rows = np.array(header["rows"], np.int64)
    read = {name: unpacked(file, rows.size, table.dtype) for name, table in tables.items()}
    for name in ("received_us", "age_us", "aged_us"):
        read["tracks"][name] += header["clock_offset_us"]
    read["first_received_us"] += header["clock_offset_us"]
    return Snapshot(
        rows=rows,
        ids=header["ids"],
        tables=read,
        events=[OpenEvent(*event) for event in header["events"]],
        pair_events=[OpenEvent(*event) for event in header["pair_events"]],
        misses=[OpenMiss(*miss) for miss in header["misses"]],
    )
