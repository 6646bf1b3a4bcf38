"""Drives of a recording, and the order of time within each.

Many tables are in the order of their senders or receivers. Records of one drive are put into the order of event time
within a window of rows, so memory stays flat however long the table is. A stretch without any record that is longer
than `SESSION_GAP_US` ends a drive: what comes hours later, or on another day, never meets it on the road.
"""

from collections import OrderedDict
from collections.abc import Iterable, Iterator
from typing import Final

from headway.gateways.recordings.reader import Row

SESSION_GAP_US: Final = 600_000_000
WINDOW_ROWS: Final = 100_000
_SESSIONS_MAX: Final = 10_000
"""Of all drives; the one without a record for longest is forgotten first."""


class _Session:
    """A drive between two long gaps."""

    def __init__(self, drive: str, t_us: int) -> None:
        self.drive = drive
        self.first_us = self.last_us = t_us

    def take(self, t_us: int) -> bool:
        """Extend it to `t_us`, unless a long gap is between."""
        if not self.first_us - SESSION_GAP_US <= t_us <= self.last_us + SESSION_GAP_US:
            return False
        self.first_us, self.last_us = min(self.first_us, t_us), max(self.last_us, t_us)
        return True


class Sessions:
    """Names the drive of each record, by the drive that its reader names and by time."""

    def __init__(self) -> None:
        self._of: OrderedDict[str, list[_Session]] = OrderedDict()
        self._made = 0

    def drive(self, name: str, t_us: int) -> str:
        """Return the name of the drive that a record of this time belongs to."""
        sessions = self._of.setdefault(name, [])
        self._of.move_to_end(name)
        session = next((one for one in reversed(sessions) if one.take(t_us)), None)
        if session is None:
            session = _Session(f"{name}#{self._made}", t_us)
            self._made += 1
            sessions.append(session)
            if self._made > _SESSIONS_MAX and len(self._of) > 1:
                self._of.popitem(last=False)
        return session.drive


def by_drive(rows: Iterable[Row]) -> Iterator[Row]:
    """Yield the rows with the drive that time gives them, in their own order."""
    sessions = Sessions()
    for row in rows:
        t_us = row.record.get("t_us")
        yield row._replace(drive=sessions.drive(row.drive, t_us)) if type(t_us) is int else row


def in_time_order(rows: Iterable[Row]) -> Iterator[Row]:
    """Yield the rows of `by_drive`, those of each drive in the order of event time; refused rows come first."""
    waiting: dict[str, list[Row]] = {}
    held = 0
    for row in by_drive(rows):
        if type(row.record.get("t_us")) is not int:
            yield row
            continue
        waiting.setdefault(row.drive, []).append(row)
        held += 1
        if held > WINDOW_ROWS:
            drive = max(waiting, key=lambda name: len(waiting[name]))
            of_drive = sorted(waiting.pop(drive), key=_t_us)
            first, rest = of_drive[: len(of_drive) // 2 + 1], of_drive[len(of_drive) // 2 + 1 :]
            if rest:
                waiting[drive] = rest
            held -= len(first)
            yield from first
    for of_drive in waiting.values():
        yield from sorted(of_drive, key=_t_us)


def _t_us(row: Row) -> int:
    return int(row.record["t_us"])
