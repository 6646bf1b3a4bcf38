"""Event updates on disk, in SQLite: one thread writes, any number of others read at the same time.

The journal never decides whether an alert is published. What cannot be written is published and counted.

An event has at most three rows: its onset, its newest update and its end. The evidence is stored once, with the onset.
When the file is too large, the oldest evidence goes first, then the details of the oldest updates, and only then the
updates themselves.
"""

import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import structlog

from headway.edge.storage.journal_format import (
    BRIEF,
    COLUMNS,
    FORMAT,
    INSERT,
    LOCK_S,
    WHOLE,
    HeldOpenError,
    OtherFormatError,
    Reason,
    StoredRow,
    move_aside,
    number,
    pack,
    prepare,
    reason_of,
    require_format,
)
from headway_schemas.event import Event, Phase

PRUNE_AT_ONCE: Final = 200
"""Rows that one step of pruning changes: a few milliseconds."""

_VACUUM_PAGES: Final = 1_024
"""Free pages in the file above which some are returned to the disk, and how many at a time."""
_WHOLE_BYTES: Final = 40_000
"""A row keeps evidence and details while at most one row follows it for each of these bytes of the limit: a quarter
of the journal at 10 kB an event."""
_REDUCTIONS: Final = (
    """DELETE FROM evidence WHERE update_id IN
       (SELECT update_id FROM evidence WHERE update_id <= :whole ORDER BY update_id LIMIT :limit)""",
    """DELETE FROM details WHERE update_id IN
       (SELECT update_id FROM details WHERE update_id <= :whole ORDER BY update_id LIMIT :limit)""",
    "DELETE FROM updates WHERE id IN (SELECT id FROM updates ORDER BY id LIMIT :limit)",
)
"""What goes when the journal is too large, least missed first; `whole` is the newest row that may lose anything."""

_UNPUBLISHED: Final = """SELECT id FROM updates WHERE site = ? AND instance = ? AND id >
    coalesce((SELECT update_id FROM published WHERE site = ? AND instance = ?), 0)"""
_OPEN_EVENTS: Final = """SELECT max(id) FROM updates WHERE site = ? AND instance = ?
    GROUP BY event_id HAVING sum(phase = 'cleared') = 0"""

_log: Final = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class EventUpdate:
    """An event, and the key and payload under which it is published."""

    event: Event
    key: str
    payload: bytes


@dataclass(frozen=True, slots=True)
class Resumed:
    """What the process before this one left in the journal."""

    newest_us: int = 0
    """Time of the newest update of all; 0: none."""
    sequence: int = 0
    """Highest sequence number; 0: none."""
    unpublished: tuple[Event, ...] = ()
    """Updates that were written and perhaps not published, oldest first."""
    open_events: tuple[Event, ...] = ()
    """The newest update of each event that has no end, oldest first."""


class Journal:
    """The writing end, for one thread. It opens the file at the first use, and again after a failure.

    Parameters
    ----------
    path
        The file; a missing folder is created.
    site, instance
        The publisher of the updates. Others may write to the same file.
    days
        Updates older than this are pruned.
    megabytes
        Largest size of the content. The write-ahead log beside it is at most as large again.
    """

    def __init__(self, path: Path, *, site: str, instance: str, days: float, megabytes: float) -> None:
        self._path = path
        self._publisher = site, instance
        self._wal = path.with_name(path.name + "-wal")
        self._days = days
        self._bytes_limit = int(megabytes * 1e6)
        self._db: sqlite3.Connection | None = None
        self._inode = 0
        self._written_ns = 0
        """When this process last changed the file."""
        self._is_changed = False
        self._config_ids: dict[str, int] = {}
        self.used_bytes = 0
        """Size of the content and of the write-ahead log, as of the last step of pruning."""

    def write(self, updates: Sequence[EventUpdate]) -> int:
        """Write all of them, or none; return the id of the last row. Raises `sqlite3.Error` or `OSError`."""
        with self._recovering():
            db = self._opened()
            self._bound_wal(db)
            db.execute("BEGIN IMMEDIATE")
            last = 0
            for update in updates:
                last = self._write(db, update)
            db.execute("COMMIT")
        return last

    def mark_published(self, row: int) -> None:
        """Note that all updates up to a row are on the bus. Raises `sqlite3.Error` or `OSError`."""
        with self._recovering():
            self._opened().execute("INSERT OR REPLACE INTO published VALUES (?, ?, ?)", (*self._publisher, row))

    def prune(self, now_us: int) -> int:
        """Delete or reduce some updates that are too old or too many; return how many rows changed.

        Raises `sqlite3.Error` or `OSError`.
        """
        with self._recovering():
            db = self._opened()
            page_bytes, pages, free = (
                number(db, f"PRAGMA {name}") for name in ("page_size", "page_count", "freelist_count")
            )
            content = page_bytes * (pages - free)
            self.used_bytes = content + self._wal_bytes
            pruned = _delete_before(db, now_us - int(self._days * 86_400e6))
            if not pruned and content > self._bytes_limit:
                pruned = self._reduce(db)
            if free > _VACUUM_PAGES:
                db.execute(f"PRAGMA incremental_vacuum({_VACUUM_PAGES})").fetchall()
        return pruned

    def check(self) -> bool:
        """Find out whether the file is there and can be read; return False when a new one had to be made.

        Raises `sqlite3.Error` or `OSError`; a damaged file has been moved aside then.
        """
        is_same = self._db is None or self._is_same_file()
        if not is_same:
            self.close()
        elif self._is_changed_by_others():
            _log.error("journal was changed by another program; its content is checked")
            self.check_content()
            self._is_changed = False
        with self._recovering():
            db = self._opened()
            db.execute("SELECT event FROM details ORDER BY update_id DESC LIMIT 1").fetchall()
            with closing(sqlite3.connect(f"{self._path.absolute().as_uri()}?mode=ro", uri=True)) as fresh:
                require_format(fresh)
                fresh.execute("SELECT event FROM details ORDER BY update_id LIMIT 1").fetchall()
        return is_same

    def check_content(self) -> None:
        """Read the whole file; a damaged one is moved aside. Raises `sqlite3.Error` or `OSError`."""
        with self._recovering():
            [(found,)] = self._opened().execute("PRAGMA quick_check(1)").fetchall()
            if found != "ok":
                error = sqlite3.DatabaseError(str(found))
                error.sqlite_errorcode = sqlite3.SQLITE_CORRUPT
                raise error

    def resume(self) -> Resumed:
        """Return what the process before this one left. Raises `sqlite3.Error` or `OSError`."""
        with self._recovering():
            db, of = self._opened(), self._publisher
            return Resumed(
                newest_us=number(db, "SELECT max(detected_us) FROM updates"),
                sequence=number(db, "SELECT max(sequence) FROM updates WHERE site = ? AND instance = ?", *of),
                unpublished=_events(db, f"{WHOLE} WHERE updates.id IN ({_UNPUBLISHED}) ORDER BY updates.id", of + of),
                open_events=_events(db, f"{BRIEF} WHERE updates.id IN ({_OPEN_EVENTS}) ORDER BY updates.id", of),
            )

    def close(self) -> None:
        """Close the file; what was not committed is undone."""
        if self._db is not None:
            self._db.close()
            self._db = None
            self._is_changed = False
            self._config_ids.clear()

    def _opened(self) -> sqlite3.Connection:
        if self._db is None:
            self._path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            self._path.touch(mode=0o600)
            db = sqlite3.connect(self._path, timeout=LOCK_S, isolation_level=None, check_same_thread=False)
            try:
                prepare(db, self._bytes_limit)
            except sqlite3.Error:
                db.close()
                raise
            self._db = db
            self._inode = self._path.stat().st_ino
        return self._db

    @contextmanager
    def _recovering(self) -> Iterator[None]:
        """Close the file after an error; move a damaged file, and one of the format before this, aside."""
        self._is_changed = self._is_changed_by_others()
        try:
            yield
            self._written_ns = self._changed_ns()
        except sqlite3.Error as error:
            self.close()
            ending = "damaged" if reason_of(error) is Reason.CORRUPT else None
            if isinstance(error, OtherFormatError) and 0 < error.found < FORMAT:
                ending = f"format-{error.found}"
            if ending is not None:
                aside = move_aside(self._path, ending)
                _log.error("journal cannot be used; a new one is begun", error=str(error), moved_to=str(aside))
            raise

    def _is_same_file(self) -> bool:
        try:
            return self._path.stat().st_ino == self._inode
        except FileNotFoundError:
            return False

    def _is_changed_by_others(self) -> bool:
        return self._is_changed or (self._db is not None and self._changed_ns() != self._written_ns)

    def _changed_ns(self) -> int:
        """Return when the file last changed; 0 where it is gone."""
        try:
            return self._path.stat().st_mtime_ns
        except OSError:
            return 0

    @property
    def _wal_bytes(self) -> int:
        try:
            return self._wal.stat().st_size
        except OSError:
            return 0

    def _reduce(self, db: sqlite3.Connection) -> int:
        newest = number(db, "SELECT max(id) FROM updates")
        place = {"whole": newest - self._bytes_limit // _WHOLE_BYTES, "limit": PRUNE_AT_ONCE}
        return next((changed for sql in _REDUCTIONS if (changed := db.execute(sql, place).rowcount)), 0)

    def _bound_wal(self, db: sqlite3.Connection) -> None:
        """Cut the write-ahead log back when it is as large as the journal may be; raise when a reader forbids it."""
        if self._wal_bytes > self._bytes_limit // 2:
            db.execute("PRAGMA busy_timeout = 0")  # a reader that holds it open is not waited for at each write
            db.execute("PRAGMA wal_checkpoint(TRUNCATE)").fetchall()
            db.execute(f"PRAGMA busy_timeout = {int(1e3 * LOCK_S)}")
            if self._wal_bytes > self._bytes_limit // 2:
                raise HeldOpenError("another process holds the journal open for reading")

    def _write(self, db: sqlite3.Connection, update: EventUpdate) -> int:
        event = update.event
        replaced = []
        if event.phase is not Phase.ONSET:
            found = "SELECT id FROM updates WHERE event_id = ? AND site = ? AND phase = 'update'"
            replaced = db.execute(found, (event.event_id, event.site)).fetchall()
        text, _, evidence = update.payload.decode().partition(',"evidence":')
        columns = [getattr(event, name) for name in COLUMNS]
        row = db.execute(INSERT, columns).lastrowid
        assert row is not None
        db.execute("INSERT INTO details VALUES (?, ?)", (row, text + "}"))
        if event.evidence is not None:
            readings, _, rest = evidence.partition(',"checkpoint":')
            _, _, parameters = rest.partition(',"parameters":')
            checkpoint = event.evidence.checkpoint
            packed = pack((readings + "}").encode()), None if checkpoint is None else pack(checkpoint)
            config = self._config_id(db, event.config_hash, parameters[:-2])
            db.execute("INSERT INTO evidence VALUES (?, ?, ?, ?)", (row, *packed, config))
        for (earlier,) in replaced:  # only now, so that the row has a higher id
            _delete(db, earlier)
        return row

    def _config_id(self, db: sqlite3.Connection, config_hash: str, parameters: str) -> int:
        if parameters not in self._config_ids:
            db.execute(
                "INSERT OR IGNORE INTO configs (config_hash, parameters) VALUES (?, ?)", (config_hash, parameters)
            )
            found = db.execute("SELECT id FROM configs WHERE parameters = ?", (parameters,)).fetchone()
            self._config_ids[parameters] = int(found[0])
        return self._config_ids[parameters]


def _delete_before(db: sqlite3.Connection, oldest_us: int) -> int:
    """Delete the oldest updates that were detected before an instant; return how many."""
    aged = "SELECT id FROM updates WHERE detected_us < ? ORDER BY detected_us LIMIT ?"
    rows = db.execute(aged, (oldest_us, PRUNE_AT_ONCE)).fetchall()
    for (row,) in rows:
        _delete(db, row)
    return len(rows)


def _delete(db: sqlite3.Connection, row: int) -> None:
    """Delete an update with its details and evidence."""
    for sql in ("updates WHERE id", "details WHERE update_id", "evidence WHERE update_id"):
        db.execute(f"DELETE FROM {sql} = ?", (row,))  # noqa: S608


def _events(db: sqlite3.Connection, sql: str, parameters: tuple[str, ...]) -> tuple[Event, ...]:
    """Return the updates that a query finds, as far as their details are still there."""
    rows = [StoredRow(*row) for row in db.execute(sql, parameters)]
    return tuple(Event.model_validate_json(row.json) for row in rows if row.event is not None)
