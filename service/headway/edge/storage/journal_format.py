"""The journal's file: its tables, what a row is, and what can be wrong with it."""

import base64
import sqlite3
import zlib
from enum import StrEnum, unique
from pathlib import Path
from typing import Final, NamedTuple

FORMAT: Final = 3
"""`user_version` of the file."""
_WAL_PAGES: Final = 1_000
"""Most pages in the write-ahead log before its content goes into the file, as SQLite has it."""
_WAL_SHARE: Final = 8
"""A small journal has a smaller log: its limit divided by this."""
PAGE_BYTES: Final = 4_096
LOCK_S: Final = 2.0
"""How long to wait while another process writes."""

_SCHEMA: Final = """
CREATE TABLE configs (id INTEGER PRIMARY KEY, config_hash TEXT NOT NULL, parameters TEXT NOT NULL UNIQUE);
CREATE TABLE updates (
    id INTEGER PRIMARY KEY,
    site TEXT NOT NULL, instance TEXT, sequence INTEGER,
    detected_us INTEGER NOT NULL, t_us INTEGER NOT NULL, event_id TEXT NOT NULL, phase TEXT NOT NULL,
    kind TEXT NOT NULL, sensor TEXT NOT NULL, suspect TEXT NOT NULL, follower TEXT NOT NULL, leader TEXT,
    model TEXT NOT NULL, config_hash TEXT NOT NULL
);
CREATE TABLE details (update_id INTEGER PRIMARY KEY, event TEXT NOT NULL);
CREATE TABLE evidence (
    update_id INTEGER PRIMARY KEY, readings BLOB NOT NULL, checkpoint BLOB, config INTEGER NOT NULL REFERENCES configs
);
CREATE TABLE published (site TEXT, instance TEXT, update_id INTEGER NOT NULL, PRIMARY KEY (site, instance));
CREATE INDEX by_time ON updates (detected_us);
CREATE INDEX by_event ON updates (event_id);
CREATE VIEW events AS SELECT
    event_id, site, suspect, kind, sensor, phase, follower, leader, t_us, detected_us,
    json_extract(event, '$.onset_us') AS onset_us, json_extract(event, '$.count') AS count,
    json_extract(event, '$.deviation.x_m') AS deviation_m, json_extract(event, '$.deviation.v_mps') AS deviation_mps,
    json_extract(event, '$.statistic') AS statistic, json_extract(event, '$.gate') AS gate,
    json_extract(event, '$.p_value') AS p_value, json_extract(event, '$.confidence') AS confidence,
    model, config_hash, event AS json
FROM updates LEFT JOIN details ON details.update_id = updates.id
WHERE NOT EXISTS (SELECT 1 FROM updates AS later
    WHERE later.event_id = updates.event_id AND later.site = updates.site AND later.id > updates.id);
"""
"""`details.event` is the JSON of an update without its evidence; missing once only the columns are left.

The view `events` is for the tools of others: a row for each event, its newest update.

`evidence.readings` is JSON, an object of `columns`, `readings` and `messages`. It and `checkpoint` are compressed by
zlib, to a third and two thirds of their size.
"""

_PACK_LEVEL: Final = 1
"""Higher levels save 4 % more and take half as long again."""

COLUMNS: Final = (
    "site", "instance", "sequence", "detected_us", "t_us", "event_id", "phase",
    "kind", "sensor", "suspect", "follower", "leader", "model", "config_hash",
)  # fmt: skip
"""Fields of an event that have columns of their own."""
INSERT: Final = f"""INSERT INTO updates (id, {", ".join(COLUMNS)}) SELECT
    1 + max(coalesce((SELECT max(id) FROM updates), 0), coalesce((SELECT max(update_id) FROM published), 0)),
    {", ".join("?" * len(COLUMNS))}"""  # noqa: S608
"""No id is used twice: one that is marked as published would else cover an update that is not."""


@unique
class Reason(StrEnum):
    """Why an event update is not in the journal."""

    DISK_FULL = "disk_full"
    LOCKED = "locked"
    HELD_OPEN = "held_open"
    """A reader holds the write-ahead log, which has grown as large as the journal may be."""
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

    def __init__(self, found: int) -> None:
        super().__init__(f"format {found} where this version reads {FORMAT}")
        self.found = found


class HeldOpenError(sqlite3.OperationalError):
    """A reader keeps the write-ahead log from being cut back."""


def reason_of(error: Exception) -> Reason:
    """Return the reason for an error of SQLite or of the system."""
    if isinstance(error, OtherFormatError):
        return Reason.OTHER_FORMAT
    if isinstance(error, HeldOpenError):
        return Reason.HELD_OPEN
    if isinstance(error, sqlite3.Error):
        return _REASONS.get(getattr(error, "sqlite_errorcode", 0) & 0xFF, Reason.IO_ERROR)
    return Reason.NO_ACCESS


class StoredRow(NamedTuple):
    """A row of `updates` with its evidence."""

    id: int
    detected_us: int
    event: str | None
    columns: str | None
    """JSON of the fields that have columns; where `event` is missing."""
    readings: bytes | None
    checkpoint: bytes | None
    parameters: str | None

    @property
    def brief(self) -> bytes:
        """JSON of the update up to its evidence, without the closing brace."""
        return (self.event or self.columns or "").removesuffix("}").encode()

    @property
    def evidence(self) -> bytes | None:
        """JSON of the evidence."""
        if self.readings is None:
            return None
        packed = "null"
        if self.checkpoint is not None:
            packed = f'"{base64.b64encode(zlib.decompress(self.checkpoint)).decode()}"'
        rest = f',"checkpoint":{packed},"parameters":{self.parameters}}}'
        return zlib.decompress(self.readings).removesuffix(b"}") + rest.encode()

    @property
    def json(self) -> bytes:
        """JSON of the update."""
        return self.brief + b',"evidence":' + (self.evidence or b"null") + b"}"


_COLUMNS_JSON: Final = "json_object({})".format(", ".join(f"'{name}', updates.{name}" for name in COLUMNS))
_EVENT: Final = f"updates.id, detected_us, event, CASE WHEN event IS NULL THEN {_COLUMNS_JSON} END"
_FROM: Final = "updates LEFT JOIN details ON details.update_id = updates.id"
BRIEF: Final = f"SELECT {_EVENT}, NULL, NULL, NULL FROM {_FROM}"  # noqa: S608
WHOLE: Final = f"""SELECT {_EVENT}, readings, checkpoint, parameters FROM {_FROM}
LEFT JOIN evidence ON evidence.update_id = updates.id LEFT JOIN configs ON configs.id = evidence.config"""  # noqa: S608
"""SQL of `StoredRow`s without and with evidence, to which conditions are added."""


def prepare(db: sqlite3.Connection, bytes_limit: int) -> None:
    """Make a journal of an empty file, and refuse a file of another format. Raises `OtherFormatError`."""
    if number(db, "PRAGMA user_version") == 0 and number(db, "SELECT count(*) FROM sqlite_schema") == 0:
        db.execute(f"PRAGMA page_size = {PAGE_BYTES}")
        db.execute("PRAGMA auto_vacuum = INCREMENTAL")
        db.executescript(f"BEGIN IMMEDIATE;{_SCHEMA};PRAGMA user_version = {FORMAT};COMMIT")
    require_format(db)
    db.execute("PRAGMA journal_mode = WAL")
    db.execute("PRAGMA synchronous = NORMAL")
    pages = max(1, min(_WAL_PAGES, bytes_limit // _WAL_SHARE // PAGE_BYTES))
    db.execute(f"PRAGMA wal_autocheckpoint = {pages}")
    db.execute(f"PRAGMA journal_size_limit = {pages * PAGE_BYTES}")


def require_format(db: sqlite3.Connection) -> None:
    """Raise `OtherFormatError` unless this is a journal of this version."""
    found = number(db, "PRAGMA user_version")
    if found != FORMAT:
        raise OtherFormatError(found)


def pack(content: bytes) -> bytes:
    """Compress what SQL does not look into."""
    return zlib.compress(content, _PACK_LEVEL)


def number(db: sqlite3.Connection, sql: str, *parameters: str) -> int:
    """Return the one number that answers an SQL query; 0 for NULL."""
    return int(db.execute(sql, parameters).fetchone()[0] or 0)


def move_aside(path: Path, ending: str) -> Path:
    """Give a file another name, so that the next use makes a new one; return that name. Raises `OSError`."""
    aside = path.with_name(f"{path.name}.{ending}")
    path.replace(aside)
    for beside in ("-wal", "-shm"):
        path.with_name(path.name + beside).unlink(missing_ok=True)
    return aside
