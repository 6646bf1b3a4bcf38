"""The reading end of the journal: pages for the bus, all rows for the commands."""

import sqlite3
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Final

from headway.edge.storage.journal_format import BRIEF, LOCK_S, WHOLE, StoredRow, require_format
from headway.edge.storage.queryable import JournalQueryable
from headway.edge.transport.ports import Query
from headway_schemas.encodings import EVENTS_JSON
from headway_schemas.query import AlertsQuery

_QUERY_S: Final = 5.0
"""A query that takes longer is refused."""
_EVIDENCE_BYTES: Final = 8 << 20
"""Most evidence in one answer; older updates come without, because zenoh drops messages above 16 MB."""
_PAGE: Final = 500
"""Rows that one statement reads."""

_CONDITIONS: Final = {
    "from_us": "detected_us >= ?",
    "to_us": "detected_us < ?",
    "before_us": "detected_us < ?",
    "kind": "kind = ?",
    "phase": "phase = ?",
    "vehicle": "? IN (suspect, follower, leader)",
    "vehicle_part": "instr(suspect || '/' || follower || '/' || coalesce(leader, ''), ?) > 0",
    "event": "event_id = ?",
    "instance": "instance = ?",
    "after_sequence": "sequence > ?",
}
"""SQL condition of each field of an `AlertsQuery` with a value; `limit` and `evidence` are no conditions."""
_NEWEST: Final = """NOT EXISTS (SELECT 1 FROM updates AS later
    WHERE later.event_id = updates.event_id AND later.site = updates.site AND later.id > updates.id)"""


def read(
    path: Path, query: AlertsQuery, *, site: str | None = None, oldest_first: bool = False, longest_s: float = 3600.0
) -> Iterator[StoredRow]:
    """Yield the event updates that meet the conditions of a query, newest first, without a limit.

    It reads a page at a time, so that the writer is never kept from cutting its log back.

    Raises
    ------
    sqlite3.Error
        There is no journal, it cannot be read, or `longest_s` is over.
    """
    over_s = time.monotonic() + longest_s
    asked = [(condition, getattr(query, name)) for name, condition in _CONDITIONS.items()] + [("site = ?", site)]
    asked = [(condition, value) for condition, value in asked if value is not None]
    way, beyond = ("ASC", ">") if oldest_first else ("DESC", "<")
    after: tuple[int, int] | None = None
    while True:
        conditions = [_NEWEST if query.newest else "TRUE", *(condition for condition, _ in asked)]
        if after is not None:
            conditions.append(f"(detected_us, updates.id) {beyond} (?, ?)")
        sql = f"{WHOLE if query.evidence else BRIEF} WHERE {' AND '.join(conditions)}"
        sql += f" ORDER BY detected_us {way}, updates.id {way} LIMIT {_PAGE}"
        with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=LOCK_S)) as db:
            db.set_progress_handler(lambda: time.monotonic() > over_s, 10_000)
            require_format(db)
            rows = [StoredRow(*row) for row in db.execute(sql, [*(value for _, value in asked), *(after or ())])]
        yield from rows
        if len(rows) < _PAGE:
            return
        after = rows[-1].detected_us, rows[-1].id


def page(path: Path, query: AlertsQuery, site: str | None = None) -> list[bytes]:
    """Return the newest `limit` updates that meet the query, and those of the same microsecond as the last.

    Raises as `read` does; it takes at most 5 s.
    """
    found: list[bytes] = []
    last_us, evidence_bytes = 0, 0
    for update in read(path, query, site=site, longest_s=_QUERY_S):
        if len(found) >= query.limit and update.detected_us != last_us:
            break
        last_us = update.detected_us
        evidence_bytes += len(update.evidence or b"")
        found.append((update if evidence_bytes <= _EVIDENCE_BYTES else update._replace(readings=None)).json)
    return found


class HistoryQueryable(JournalQueryable):
    """Answers queries for the history of events; it calls `on_damage` when it finds the file damaged."""

    trouble = "the journal cannot be read"

    def __init__(self, path: Path, site: str, on_damage: Callable[[], None]) -> None:
        super().__init__("headway-history", on_damage)
        self._path = path
        self._site = site

    def _found(self, query: Query) -> tuple[bytes, str]:
        found = page(self._path, AlertsQuery.from_parameters(query.parameters), self._site)
        return b"[" + b",".join(found) + b"]", EVENTS_JSON
