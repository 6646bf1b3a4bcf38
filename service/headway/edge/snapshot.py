"""What the detector knows, on disk: a service that is started again goes on with the vehicles it knew.

The state is copied a slice in each turn, so that no turn takes long, and written by a thread of its own. The file is a
line of JSON and the tables as they are in memory: only the same core in the same configuration reads it.
"""

import json
import os
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import structlog

from headway.core.engine import Engine
from headway.core.snapshot import OpenEvent, OpenMiss, Snapshot, whole
from headway.edge.clock import Clock
from headway.edge.outbox import Outbox
from headway.edge.vitals import Identity

_SLICES: Final = 64
_CLOSE_S: Final = 5.0
_FORMAT: Final = "headway-snapshot-1"

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
            snapshot = _read(self._path, self._fingerprint(), self._engine)
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
            _write(self._path, self._fingerprint(), whole(parts))
        except OSError as error:
            self.failed += 1
            if self.trouble is None:
                _log.error("snapshot cannot be written", file=str(self._path), error=str(error))
            self.trouble = error.strerror or str(error)
        else:
            self.written += 1
            self.trouble = None

    def _fingerprint(self) -> dict[str, str]:
        identity = self._identity
        return {
            "format": _FORMAT,
            "site": identity.site,
            "config_hash": identity.config_hash,
            "core": identity.core,
            "byteorder": os.sys.byteorder,
        }


def _write(path: Path, fingerprint: dict[str, str], snapshot: Snapshot) -> None:
    """Replace the file, so that there is a whole one at any time."""
    tables = {name: table.tobytes() for name, table in sorted(snapshot.tables.items())}
    header = {
        "fingerprint": fingerprint,
        "rows": snapshot.rows.tolist(),
        "ids": snapshot.ids,
        "events": snapshot.events,
        "link_events": snapshot.link_events,
        "misses": snapshot.misses,
        "crc32": {name: zlib.crc32(table) for name, table in tables.items()},
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(path.name + ".new")
    with fresh.open("wb") as file:
        file.write(json.dumps(header).encode() + b"\n")
        for table in tables.values():
            file.write(table)
        file.flush()
        os.fsync(file.fileno())
    fresh.replace(path)


def _read(path: Path, fingerprint: dict[str, str], engine: Engine) -> Snapshot:
    """Read a file that `_write` made. Raises `OSError`, or `ValueError` where it does not fit."""
