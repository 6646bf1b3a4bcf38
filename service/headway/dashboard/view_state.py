"""The state behind the views: the newest state of each pair, event updates, the health of each instance.

Each entry carries the revision at which it changed. A viewer keeps the revision of its last frame and receives the
changes since. So a slow viewer needs no queue, and a pair that changed ten times is sent once.
"""

from collections import OrderedDict
from collections.abc import Hashable, Iterator
from typing import Any, Final, Generic, TypeAlias, TypeVar

from headway.client import SiteMessage
from headway.dashboard.event_summary import EventSummary
from headway_schemas import Event, Health, PairState, RejectedCopy, SensorQuality
from headway_schemas.handling import Action, Handling
from headway_schemas.query import LIMIT_MAX, AlertsQuery
from headway_schemas.sequence import SequenceGaps

Row: TypeAlias = dict[str, Any]

PAIR_LIMIT: Final = 20_000
PAIR_TTL_US: Final = 60_000_000
UPDATE_LIMIT: Final = 2_000
EVENT_LIMIT: Final = 2_000
INSTANCE_LIMIT: Final = 64
INSTANCE_TTL_US: Final = 600_000_000
COPY_LIMIT: Final = 50
SILENT_US: Final = 10_000_000
_REPORT_DUE_US: Final = 4_000_000
_INTERVALS_DUE: Final = 2.5

PAIR_COLUMNS: Final = (
    "site", "follower", "leader", "standing", "t_us",
    "lat", "lon", "heading_deg", "gap_m", "offset_m", "v_mps", "statistic", "gate",
)  # fmt: skip
_HEALTH_SHOWN: Final = {
    "instance", "site", "t_us", "version", "model", "config_hash", "ready", "uptime_s", "vehicles", "pairs", "capacity",
    "queue_depth", "queue_limit", "scored", "warming", "rejected", "lost", "events", "latency_ms", "rss_mb",
}  # fmt: skip

_RATES: Final = ("scored", "warming", "rejected", "lost")

K = TypeVar("K", bound=Hashable)
V = TypeVar("V")


class Table(Generic[K, V]):
    """Values by key in the order of their last change; above `limit` the oldest is evicted."""

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
        """Return what changed after `revision`, oldest first."""
        newest_first: list[V] = []
        for changed, value in reversed(self._entries.values()):
            if changed <= revision:
                break
            newest_first.append(value)
        return newest_first[::-1]

    def evict(self, revision: int) -> None:
        """Evict what has not changed after `revision`."""
        while self._entries and next(iter(self._entries.values()))[0] <= revision:
            self._entries.popitem(last=False)

    def __iter__(self) -> Iterator[V]:
        """Iterate over the values, oldest first."""
        return (value for _, value in self._entries.values())


class ViewState:
    """The tables. A revision is the time of a refresh in microseconds, so it gives both age and order."""

    def __init__(self) -> None:
        self.pairs: Table[tuple[str, str], tuple[Any, ...]] = Table(PAIR_LIMIT)
        """Values of `PAIR_COLUMNS` by site and follower."""
        self.updates: Table[tuple[str, str, str, int], Event] = Table(UPDATE_LIMIT)
        self.events: Table[tuple[str, str], EventSummary] = Table(EVENT_LIMIT)
        """By site and event id."""
        self.qualities: Table[tuple[str, str], Row] = Table(PAIR_LIMIT)
        """By site and vehicle."""
        self.handlings: Table[tuple[str, str, bool], Handling] = Table(PAIR_LIMIT)
        """The newest decision and the newest note (True) by site and vehicle."""
        self.instances: Table[tuple[str, str], Row] = Table(INSTANCE_LIMIT)
        self.copies: Table[int, Row] = Table(COPY_LIMIT)
        self.instance_starts = 0
        """Starts of instances, new or again: each may have events from before."""
        self.missing: list[tuple[str, AlertsQuery]] = []
        """Sites and queries for the event updates that were published and not received."""
        self._gaps = SequenceGaps()
        self._copies_received = 0

    def apply(self, received: SiteMessage, revision: int) -> None:
        """Apply one message."""
        match received.message:
            case PairState() as state:
                self.pairs.put((state.site, state.follower), pair_row(state), revision)
            case Event() as event:
                after = self._gaps.missing_after(event)
                if after is not None:
                    query = AlertsQuery(instance=event.instance, after_sequence=after, limit=LIMIT_MAX)
                    self.missing.append((event.site, query))
                self.apply_event(event, revision)
            case Health() as health:
                self._apply_health(health, revision)
            case SensorQuality() as quality:
                self.qualities.put((quality.site, quality.vehicle), quality.model_dump(mode="json"), revision)
            case Handling() as handling:
                self.apply_handling(handling, revision)
            case RejectedCopy() as copy:
                self._copies_received += 1
                self.copies.put(self._copies_received, copy_row(received.site, copy), revision)

    def apply_event(self, event: Event, revision: int) -> None:
        """Apply an event update, live or from the history; a known one only gains evidence and what it shows."""
        key = (event.site, event.event_id, event.phase, event.detected_us)
        known = self.updates.get(key)
        if known is not None and (known.evidence is not None or event.evidence is None):
            return
        self.updates.put(key, event, revision)
        self._summarise(event, revision, is_new=known is None)

    def apply_handling(self, handling: Handling, revision: int) -> None:
        """Apply how a person handles a vehicle, unless a newer decision is known."""
        key = (handling.site, handling.vehicle, handling.action is Action.NOTE)
        known = self.handlings.get(key)
        if known is None or known.t_us < handling.t_us:
            self.handlings.put(key, handling, revision)

    def evict(self, revision: int) -> None:
        """Evict pairs and instances that have been silent for their time to live."""
        self.pairs.evict(revision - PAIR_TTL_US)
        self.qualities.evict(revision - PAIR_TTL_US)
        self.instances.evict(revision - INSTANCE_TTL_US)

    def reporting_sites(self, now_us: int) -> set[str]:
        """Return the sites of which a health report came lately."""
        return {row["site"] for row in self.instances if now_us - row["received_us"] < SILENT_US}

    def delta(self, since: int) -> Row:
        """Return what changed after the revision `since`; 0 gives everything."""
        return {
            "pairs": {"columns": PAIR_COLUMNS, "rows": self.pairs.since(since)},
            "updates": [update_row(event) for event in self.updates.since(since)],
            "instances": self.instances.since(since),
            "copies": self.copies.since(since),
            "events": [event.row() for event in self.events.since(since)],
            "qualities": self.qualities.since(since),
            "handlings": [handling.model_dump(mode="json") for handling in self.handlings.since(since)],
        }

    def _summarise(self, event: Event, revision: int, *, is_new: bool) -> None:
        key = (event.site, event.event_id)
        summary = self.events.get(key)
        if summary is None:
            summary = EventSummary.of(event)
        else:
            summary.add(event, is_new=is_new)
        self.events.put(key, summary, revision)

    def _apply_health(self, health: Health, revision: int) -> None:
        key = (health.site, health.instance)
        before = self.instances.get(key)
        row = health.model_dump(mode="json", include=_HEALTH_SHOWN)
        if before is None or before["uptime_s"] > row["uptime_s"]:
            self.instance_starts += 1
            before = row
        interval_us = revision - before.get("received_us", revision)
        timing = {"received_us": revision, "interval_us": interval_us}
        self.instances.put(key, row | timing | {"rates_hz": _rates(before, row)}, revision)


def silence_us(instance: Row, now_us: int) -> int:
    """Return for how long an instance has been silent beyond its own interval; 0 while it reports."""
    silent_us: int = now_us - instance["received_us"]
    return silent_us if silent_us > max(_REPORT_DUE_US, _INTERVALS_DUE * instance["interval_us"]) else 0


def pair_row(state: PairState) -> tuple[Any, ...]:
    """Return the values of `PAIR_COLUMNS`."""
    return tuple(getattr(state, column) for column in PAIR_COLUMNS)


def update_row(event: Event) -> Row:
    """Return an event update without its evidence, which `/event/{event_id}` gives."""
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
