"""What the views know: the newest state of every pair, the statements about events, the health of every instance.

Everything carries the revision at which it came. A viewer keeps the revision it was told last and is told what came
since: however slow it is there is no queue to grow, and a pair that changed ten times is told once.
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator
from typing import Any, Final, Generic, TypeAlias, TypeVar

from headway.client import Heard
from headway_schemas import Event, Health, PairState, RejectedCopy

Row: TypeAlias = dict[str, Any]

PAIR_LIMIT: Final = 20_000
PAIR_FORGET_US: Final = 60_000_000
STATEMENT_LIMIT: Final = 2_000
INSTANCE_LIMIT: Final = 64
INSTANCE_FORGET_US: Final = 600_000_000
COPY_LIMIT: Final = 50

PAIR_COLUMNS: Final = (
    "site", "follower", "leader", "standing", "t_us",
    "lat", "lon", "heading_deg", "gap_m", "v_mps", "statistic", "gate",
)  # fmt: skip
_HEALTH_SHOWN: Final = {
    "instance", "site", "t_us", "version", "model", "config_hash", "ready", "uptime_s", "vehicles", "pairs", "capacity",
    "queue_depth", "queue_limit", "scored", "warming", "rejected", "lost", "events", "latency_ms", "rss_mb",
}  # fmt: skip

_RATES: Final = ("scored", "warming", "rejected", "lost")

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Table(Generic[K, V]):
    """Values by key in the order of their last change; at `limit` the stalest gives way."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._entries: OrderedDict[K, tuple[int, V]] = OrderedDict()

    def __len__(self) -> int:
        """Return how many values there are."""
        return len(self._entries)

    def get(self, key: K) -> V | None:
        """Return the value of `key`, None where there is none."""
        entry = self._entries.get(key)
        return None if entry is None else entry[1]

    def put(self, key: K, value: V, revision: int) -> None:
        """Set a value and make it the newest."""
        self._entries[key] = (revision, value)
        self._entries.move_to_end(key)
        if len(self._entries) > self._limit:
            self._entries.popitem(last=False)

    def since(self, revision: int) -> list[V]:
        """Return what changed after `revision`, stalest first."""
        newest_first: list[V] = []
        for changed, value in reversed(self._entries.values()):
            if changed <= revision:
                break
            newest_first.append(value)
        return newest_first[::-1]

    def forget(self, revision: int) -> None:
        """Drop what has not changed after `revision`."""
        while self._entries and next(iter(self._entries.values()))[0] <= revision:
            self._entries.popitem(last=False)

    def __iter__(self) -> Iterator[V]:
        """Go through the values, stalest first."""
        return (value for _, value in self._entries.values())


class Board:
    """The tables. A revision is the instant of a turn, in microseconds, so age and order are one number."""

    def __init__(self) -> None:
        self.pairs: Table[tuple[str, str], tuple[Any, ...]] = Table(PAIR_LIMIT)
        """Values of `PAIR_COLUMNS` by site and follower."""
        self.statements: Table[tuple[str, str, str, int], Event] = Table(STATEMENT_LIMIT)
        self.instances: Table[tuple[str, str], Row] = Table(INSTANCE_LIMIT)
        self.copies: Table[int, Row] = Table(COPY_LIMIT)
        self.arrivals = 0
        """Instances that came new or came back: each may have a history that was not heard."""
        self._copies_heard = 0

    def take(self, heard: Heard, revision: int) -> None:
        """Take in one message."""
        match heard.message:
            case PairState() as state:
                self.pairs.put((state.site, state.follower), pair_row(state), revision)
            case Event() as event:
                self.take_event(event, revision)
            case Health() as health:
                self._take_health(health, revision)
            case RejectedCopy() as copy:
                self._copies_heard += 1
                self.copies.put(self._copies_heard, copy_row(heard.site, copy), revision)

    def take_event(self, event: Event, revision: int) -> None:
        """Take in a statement, heard or from a history; one that is known already only gains evidence."""
        key = (event.site, event.event_id, event.phase, event.detected_us)
        known = self.statements.get(key)
        if known is None or (known.evidence is None and event.evidence is not None):
            self.statements.put(key, event, revision)

    def forget(self, revision: int) -> None:
        """Drop the pairs and instances that have been quiet for long."""
        self.pairs.forget(revision - PAIR_FORGET_US)
        self.instances.forget(revision - INSTANCE_FORGET_US)

    def delta(self, since: int) -> Row:
        """Return what changed after the revision `since`; 0 gives everything."""
        return {
            "pairs": {"columns": PAIR_COLUMNS, "rows": self.pairs.since(since)},
            "statements": [statement_row(event) for event in self.statements.since(since)],
            "instances": self.instances.since(since),
            "copies": self.copies.since(since),
        }

    def _take_health(self, health: Health, revision: int) -> None:
        key = (health.site, health.instance)
        before = self.instances.get(key)
        row = health.model_dump(mode="json", include=_HEALTH_SHOWN)
        if before is None or before["uptime_s"] > row["uptime_s"]:
            self.arrivals += 1
            before = row
        self.instances.put(key, row | {"rates_hz": _rates(before, row)}, revision)


def pair_row(state: PairState) -> tuple[Any, ...]:
    """Return the values of `PAIR_COLUMNS`."""
    return tuple(getattr(state, column) for column in PAIR_COLUMNS)


def statement_row(event: Event) -> Row:
    """Return a statement without its evidence, which is asked for by event."""
    return event.model_dump(mode="json", exclude={"evidence"}) | {"has_evidence": event.evidence is not None}


def copy_row(site: str, copy: RejectedCopy) -> Row:
    """Return a rejected message without its payload."""
    return {"site": site} | copy.model_dump(mode="json", include={"reason", "detail", "sender", "received_us", "count"})


def _rates(before: Row, now: Row) -> Row:
    """Return records per second by outcome, between two reports of one instance."""
    elapsed_s = (now["t_us"] - before["t_us"]) / 1e6
    if elapsed_s <= 0:
        return {}
    return {name: max(0.0, (_count(now[name]) - _count(before[name])) / elapsed_s) for name in _RATES}


def _count(outcome: int | dict[str, int]) -> int:
    return sum(outcome.values()) if isinstance(outcome, dict) else outcome
