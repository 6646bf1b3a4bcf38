"""How people handle vehicles, in the journal's file: stored, published and listed on request."""

import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final

from headway.edge.clock import Clock
from headway.edge.storage.journal_format import LOCK_S
from headway.edge.storage.queryable import JournalQueryable
from headway.edge.transport.ports import Query
from headway_schemas.encodings import HANDLINGS_JSON
from headway_schemas.handling import HANDLINGS, Action, Handling, HandlingRequest

HANDLINGS_MAX: Final = 10_000
"""Most that are kept; the oldest go first."""
_REQUEST_BYTES_MAX: Final = 4_096
_TABLE: Final = """CREATE TABLE IF NOT EXISTS handlings (
    id INTEGER PRIMARY KEY, site TEXT NOT NULL, vehicle TEXT NOT NULL, is_note INTEGER NOT NULL, handling TEXT NOT NULL
)"""
_NEWEST: Final = """SELECT handling FROM handlings WHERE id IN
    (SELECT max(id) FROM handlings WHERE site = coalesce(?, site) GROUP BY site, vehicle, is_note) ORDER BY id"""


def newest(path: Path, site: str | None = None) -> list[Handling]:
    """Return of each vehicle the newest decision and the newest note, oldest first. Raises `sqlite3.Error`."""
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=LOCK_S)) as db:
        if not db.execute("SELECT 1 FROM sqlite_schema WHERE name = 'handlings'").fetchall():
            return []
        return [Handling.model_validate_json(text) for (text,) in db.execute(_NEWEST, (site,))]


def store(path: Path, handling: Handling) -> None:
    """Store a handling. Raises `sqlite3.Error`."""
    with _writing(path) as db:
        db.execute(_TABLE)
        columns = (handling.site, handling.vehicle, handling.action is Action.NOTE, handling.model_dump_json())
        db.execute("INSERT INTO handlings (site, vehicle, is_note, handling) VALUES (?, ?, ?, ?)", columns)
        db.execute("DELETE FROM handlings WHERE id <= (SELECT max(id) FROM handlings) - ?", (HANDLINGS_MAX,))


@contextmanager
def _writing(path: Path) -> Iterator[sqlite3.Connection]:
    address = f"{path.absolute().as_uri()}?mode=rw"
    with closing(sqlite3.connect(address, uri=True, timeout=LOCK_S, isolation_level=None)) as db:
        db.execute("PRAGMA wal_autocheckpoint = 0")  # the journal does, and takes others for outsiders
        db.execute("BEGIN IMMEDIATE")
        yield db
        db.execute("COMMIT")


class HandlingQueryable(JournalQueryable):
    """Answers requests to handle a vehicle, and queries for all; it calls `publish` with what it stored."""

    trouble = "the journal cannot be used"

    def __init__(self, path: Path, site: str, clock: Clock, publish: Callable[[Handling], None]) -> None:
        super().__init__("headway-handling")
        self._path = path
        self._site = site
        self._clock = clock
        self._publish = publish

    def _found(self, query: Query) -> tuple[bytes, str]:
        found = [self._handle(query.payload)] if query.payload else newest(self._path, self._site)
        return HANDLINGS.dump_json(found), HANDLINGS_JSON

    def _handle(self, payload: bytes) -> Handling:
        asked = HandlingRequest.model_validate_json(payload[:_REQUEST_BYTES_MAX])
        handling = Handling(**asked.model_dump(), site=self._site, t_us=self._clock.wall_us())
        store(self._path, handling)
        self._publish(handling)
        return handling
