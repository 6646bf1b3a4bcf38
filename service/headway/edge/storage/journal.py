"""Every event update on disk, in SQLite: one thread writes, any number of others read at the same time.

The journal never decides whether an alert is published. What cannot be written is published and counted.
"""

import sqlite3
from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum, unique
from pathlib import Path
from typing import Any, Final

from headway_schemas.event import Event

FORMAT: Final = 1
"""`user_version` of the file."""
PRUNE_AT_ONCE: Final = 200
"""Event updates that one step of pruning deletes: a few milliseconds."""

_VACUUM_PAGES: Final = 1_024
"""Free pages in the file above which some are returned to the disk, and how many at a time."""
_WAL_BYTES: Final = 16 << 20
LOCK_S: Final = 5.0
"""How long to wait while another process writes."""

_SCHEMA: Final = """
CREATE TABLE configs (id INTEGER PRIMARY KEY, config_hash TEXT NOT NULL, parameters BLOB NOT NULL UNIQUE);
CREATE TABLE statements (
    id INTEGER PRIMARY KEY,
    site TEXT NOT NULL, detected_us INTEGER NOT NULL, event_id TEXT NOT NULL, phase TEXT NOT NULL, kind TEXT NOT NULL,
    suspect TEXT NOT NULL, follower TEXT NOT NULL, leader TEXT,
    told BLOB NOT NULL,
    evidence BLOB,
    config INTEGER REFERENCES configs
);
CREATE INDEX by_time ON statements (detected_us);
CREATE INDEX by_event ON statements (event_id);
"""
"""Format 1, whose names stay: a row of `statements` is an event update. `told` is its JSON up to the evidence,
`evidence` that of the evidence up to its parameters."""

_INSERT: Final = (
    "INSERT INTO statements"
    " (site, detected_us, event_id, phase, kind, suspect, follower, leader, told, evidence, config)"
    " VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?)"
)


@unique
class Reason(StrEnum):
    """Why an event update is not in the journal."""

    DISK_FULL = "disk_full"
    LOCKED = "locked"
    CORRUPT = "corrupt"
    NO_ACCESS = "no_access"
    OTHER_FORMAT = "other_format"
    IO_ERROR = "io_error"
    QUEUE_FULL = "queue_full"
    """The disk was too slow for too long."""


_REASONS: Final = {
    sqlite3.SQLITE_FULL: Reason.DISK_FULL,
    sqlite3.SQLITE_BUSY: Reason.LOCKED,
    sqlite3.SQLITE_LOCKED: Reason.LOCKED,
    sqlite3.SQLITE_CORRUPT: Reason.CORRUPT,
    sqlite3.SQLITE_NOTADB: Reason.CORRUPT,
    sqlite3.SQLITE_CANTOPEN: Reason.NO_ACCESS,
    sqlite3.SQLITE_READONLY: Reason.NO_ACCESS,
    sqlite3.SQLITE_PERM: Reason.NO_ACCESS,
}


class OtherFormatError(sqlite3.DatabaseError):
    """The file is of another version of headway, or no journal at all."""


def reason_of(error: Exception) -> Reason:
    """Return the reason for an error of SQLite or of the system."""
    if isinstance(error, OtherFormatError):
        return Reason.OTHER_FORMAT
    if isinstance(error, sqlite3.Error):
        return _REASONS.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, Reason.IO_ERROR)
    return Reason.NO_ACCESS


@dataclass(frozen=True, slots=True)
class EventUpdate:
    """An event, and the key and payload under which it is published."""

    event: Event
    key: str
    payload: bytes


class Journal:
    """The writing end, for one thread. It opens the file at the first use, and again after a failure.

    Parameters
    ----------
    path
        The file; a missing folder is created.
    days
        Updates older than this are pruned.
    megabytes
        The oldest updates are pruned when the file is larger than this.
    """

    def __init__(self, path: Path, *, days: float, megabytes: float) -> None:
        self._path = path
        self._days = days
        self._bytes_limit = int(megabytes * 1e6)
        self._db: sqlite3.Connection | None = None
        self._config_ids: dict[bytes, int] = {}
        self.used_bytes = 0
        """Size of the content, as of the last step of pruning."""

    def write(self, updates: Sequence[EventUpdate]) -> None:
        """Write all of them, or none. Raises `sqlite3.Error` or `OSError`."""
        try:
            db = self._opened()
            db.execute("BEGIN IMMEDIATE")
            db.executemany(_INSERT, [self._row(db, update) for update in updates])
            db.execute("COMMIT")
        except sqlite3.Error:
            self.close()
            raise

    def prune(self, now_us: int) -> int:
        """Delete some updates that are too old or too many; return how many. Raises `sqlite3.Error` or `OSError`."""
        try:
            db = self._opened()
            page_bytes, pages, free = (
                number(db, f"PRAGMA {name}") for name in ("page_size", "page_count", "freelist_count")
            )
            self.used_bytes = page_bytes * (pages - free)
            oldest_us = now_us - int(self._days * 86_400e6)
            aged = " WHERE detected_us < ?" if self.used_bytes <= self._bytes_limit else " WHERE ? NOT NULL"
            oldest = f"SELECT id FROM statements{aged} ORDER BY detected_us LIMIT {PRUNE_AT_ONCE}"  # noqa: S608
            pruned = db.execute(f"DELETE FROM statements WHERE id IN ({oldest})", (oldest_us,)).rowcount  # noqa: S608
            if free > _VACUUM_PAGES:
                db.execute(f"PRAGMA incremental_vacuum({_VACUUM_PAGES})").fetchall()
        except sqlite3.Error:
            self.close()
            raise
        return pruned

    def close(self) -> None:
        """Close the file; what was not committed is undone."""
        if self._db is not None:
            self._db.close()
            self._db = None
            self._config_ids.clear()

    def _opened(self) -> sqlite3.Connection:
        if self._db is None:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            db = sqlite3.connect(self._path, timeout=LOCK_S, isolation_level=None, check_same_thread=False)
            try:
                _prepare(db)
            except sqlite3.Error:
                db.close()
                raise
            self._db = db
        return self._db

    def _row(self, db: sqlite3.Connection, update: EventUpdate) -> tuple[Any, ...]:
        event = update.event
        told, _, evidence = update.payload.partition(b',"evidence":')
        config = None
        if event.evidence is not None:
            evidence, _, parameters = evidence.rpartition(b',"parameters":')
            config = self._config_id(db, event.config_hash, parameters[:-2])
        return (
            event.site,
            event.detected_us,
            event.event_id,
            event.phase,
            event.kind,
            event.suspect,
            event.follower,
            event.leader,
            told,
            evidence if config is not None else None,
            config,
        )

    def _config_id(self, db: sqlite3.Connection, config_hash: str, parameters: bytes) -> int:
        if parameters not in self._config_ids:
            db.execute(
                "INSERT OR IGNORE INTO configs (config_hash, parameters) VALUES (?, ?)", (config_hash, parameters)
            )
            found = db.execute("SELECT id FROM configs WHERE parameters = ?", (parameters,)).fetchone()
            self._config_ids[parameters] = int(found[0])
        return self._config_ids[parameters]


def _prepare(db: sqlite3.Connection) -> None:
    """Make a journal of an empty file, and refuse a file of another format."""
    if number(db, "PRAGMA user_version") == 0 and number(db, "SELECT count(*) FROM sqlite_schema") == 0:
        db.execute("PRAGMA auto_vacuum = INCREMENTAL")
        db.executescript(f"BEGIN IMMEDIATE;{_SCHEMA};PRAGMA user_version = {FORMAT};COMMIT")
    require_format(db)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = NORMAL")
    db.execute(f"PRAGMA journal_size_limit = {_WAL_BYTES}")


def require_format(db: sqlite3.Connection) -> None:
    """Raise `OtherFormatError` unless this is a journal of this version."""
    found = number(db, "PRAGMA user_version")
    if found != FORMAT:
        raise OtherFormatError(f"format {found} where this version reads {FORMAT}")


def number(db: sqlite3.Connection, sql: str) -> int:
    """Return the one number that answers an SQL query."""
    return int(db.execute(sql).fetchone()[0])
