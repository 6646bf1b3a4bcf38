"""Engine events as numbered updates, and a quota for each suspect.

A suspect publishes its first events one by one. Beyond its quota they are summarised in one event that counts them, so
that no sender fills the journal or the bus, however often it raises an alarm.

An update costs half a millisecond, most of it for the evidence. So an iteration of the loop makes a bounded number, and
the others wait for the next: thousands of onsets at once do not hold up detection.
"""

from collections import deque
from collections.abc import Collection, Container, Iterable, Iterator
from dataclasses import dataclass, field, replace
from typing import Final, NamedTuple

from headway.core.types.records import Kind
from headway.core.types.step_result import AnomalyEvent
from headway.core.types.step_result import Phase as OfEngine
from headway.edge.codec.messages import Timing, encode, event_message
from headway.edge.identity import Identity
from headway.edge.message_history import MessageHistory
from headway.edge.storage.journal import EventUpdate
from headway_schemas.event import Event, Phase
from headway_schemas.keys import Keys

SUMMARY_EVERY_NS: Final = 10_000_000_000
"""From one update of a summary to the next."""
QUIET_NS: Final = 60_000_000_000
"""A summary ends this long after the last update of what it counts, also where a vehicle left and no end followed."""
_LOOK_EVERY_NS: Final = 1_000_000_000
"""How often summaries are looked at."""
AT_ONCE: Final = 50
"""Updates that one iteration makes of events,"""
SHARE_AT_ONCE: Final = 0.05
"""or this share of those that wait, if that is more. So a flood of alarms slows the loop down, and few wait."""


class _Found(NamedTuple):
    """What the engine found."""

    event: AnomalyEvent
    timing: Timing


@dataclass(slots=True)
class _Suspect:
    """What is left of a suspect's quota, and its summary."""

    events_left: float
    refilled_ns: int
    counted: int = 0
    summary: Event | None = None
    newest: AnomalyEvent | None = None
    """The newest that the summary counts, of a known kind if any is; without evidence."""
    deviation: tuple[float, float] = (0.0, 0.0)
    """The largest of those that the summary counts."""
    updated_ns: int = 0
    newest_ns: int = 0
    summarised: set[str] = field(default_factory=set)
    """Events that the summary counts and that are not known to have ended."""


class EventUpdates:
    """Makes event updates of what the engine found.

    Parameters
    ----------
    history
        Original messages, for the evidence.
    burst
        Events of one suspect that are published one by one.
    refill_s
        After this long one more is.
    """

    def __init__(self, identity: Identity, keys: Keys, history: MessageHistory, *, burst: int, refill_s: float) -> None:
        self._identity = identity
        self._history = history
        self._keys = keys
        self._burst = burst
        self._refill_ns = refill_s * 1e9
        self._suspects: dict[str, _Suspect] = {}
        self._found: deque[_Found] = deque()
        self._open: dict[str, Event] = {}
        """The newest update of each event that has no end yet, without evidence."""
        self._sequence = 0
        self._look_ns = 0
        self.summarised = 0
        """Events that were counted in a summary and not published."""

    @property
    def has_open(self) -> bool:
        """Whether any published event has no end yet."""
        return bool(self._open)

    @property
    def waiting(self) -> int:
        """Events of which no update is made yet."""
        return len(self._found)

    def adopt(self, events: Iterable[Event]) -> None:
        """Take over events that a process before this one published and did not end."""
        self._open |= {event.event_id: event for event in events}

    def resume_after(self, sequence: int) -> None:
        """Go on after a sequence number."""
        self._sequence = sequence

    def of(self, events: Iterable[AnomalyEvent], now_ns: int, timing: Timing) -> list[EventUpdate]:
        """Take what the engine found; return the updates to publish, of the oldest events that wait.

        `now_ns` is monotonic and decides quotas.
        """
        self._found.extend(_Found(event, timing) for event in events)
        count = min(len(self._found), max(AT_ONCE, round(SHARE_AT_ONCE * len(self._found))))
        updates = self._updates((self._found.popleft() for _ in range(count)), now_ns)
        if now_ns >= self._look_ns:
            self._look_ns = now_ns + _LOOK_EVERY_NS
            updates += map(self._number, self._summaries(now_ns, timing))
        return updates

    def _updates(self, found: Iterable[_Found], now_ns: int) -> list[EventUpdate]:
        updates = []
        for event, timing in found:
            if self._admit(event, now_ns, timing):
                message = event_message(event, self._identity, timing, self._history.of)
                self._open[event.event_id] = message.model_copy(update={"evidence": None})
                updates.append(self._number(message))
        return updates

    def release(self, event_ids: Collection[str], now_ns: int) -> list[EventUpdate]:
        """Leave open events to another service, which continues and ends them; return what waits of them as updates."""
        left = [found for found in self._found if found.event.event_id in event_ids]
        if left:
            self._found = deque(found for found in self._found if found.event.event_id not in event_ids)
        updates = self._updates(left, now_ns)
        for event_id in event_ids:
            self._open.pop(event_id, None)
        return updates

    def end_others(self, known: Container[str], now_us: int) -> list[EventUpdate]:
        """Return the ends of the open events that are not among the known ids; none while the ends of others wait."""
        if self._found:
            return []
        end = {"phase": Phase.CLEARED, "detected_us": now_us, "evidence": None}
        ended = [event for event_id, event in self._open.items() if event_id not in known]
        return [self._number(event.model_copy(update=end)) for event in ended]

    def again(self, event: Event) -> EventUpdate:
        """Return an update as it is, or as a process before this one wrote it and perhaps did not publish it."""
        event = event.model_copy(update={"epoch": self._identity.epoch})
        return EventUpdate(event, self._keys.alert(event.kind, event.suspect), encode(event))

    def _number(self, event: Event) -> EventUpdate:
        self._sequence += 1
        if event.phase is Phase.CLEARED:
            self._open.pop(event.event_id, None)
        numbered = event.model_copy(update={"instance": self._identity.instance, "sequence": self._sequence})
        return self.again(numbered)

    def _admit(self, event: AnomalyEvent, now_ns: int, timing: Timing) -> bool:
        """Whether an event is published as it is; otherwise it is counted."""
        suspect = self._suspects.get(event.suspect)
        if suspect is None:
            suspect = self._suspects[event.suspect] = _Suspect(float(self._burst), now_ns)
        if event.phase is OfEngine.ONSET:
            refill = (now_ns - suspect.refilled_ns) / self._refill_ns
            suspect.events_left = min(self._burst, suspect.events_left + max(0.0, refill))
            suspect.refilled_ns = now_ns
            if suspect.events_left >= 1.0 and suspect.summary is None:
                suspect.events_left -= 1.0
                return True
            self._count(suspect, event, now_ns, timing)
            return False
        if event.event_id not in suspect.summarised:
            return True
        suspect.newest_ns = now_ns
        self._note(suspect, event)
        if event.phase is OfEngine.CLEARED:
            suspect.summarised.discard(event.event_id)
        return False

    def _count(self, suspect: _Suspect, event: AnomalyEvent, now_ns: int, timing: Timing) -> None:
        self.summarised += 1
        suspect.summarised.add(event.event_id)
        suspect.counted += 1
        suspect.newest_ns = now_ns
        self._note(suspect, event)
        if suspect.summary is None:
            suspect.summary = event_message(event, self._identity, timing, self._history.of)
            self._look_ns = now_ns  # its onset is an alert like any other

    @staticmethod
    def _note(suspect: _Suspect, event: AnomalyEvent) -> None:
        """Take note of an update that the summary counts."""
        if suspect.newest is None or event.kind is not Kind.UNKNOWN:
            suspect.newest = replace(event, evidence=None)
        suspect.deviation = (
            max(suspect.deviation[0], event.deviation[0]),
            max(suspect.deviation[1], event.deviation[1]),
        )

    def _summaries(self, now_ns: int, timing: Timing) -> Iterator[Event]:
        """Yield the summaries that are due, and drop suspects whose quota is whole again."""
        for name, suspect in list(self._suspects.items()):
            if suspect.summary is not None:
                yield from self._summary(suspect, suspect.summary, now_ns, timing)
            elif now_ns - suspect.refilled_ns > self._burst * self._refill_ns:
                del self._suspects[name]

    def _summary(self, suspect: _Suspect, summary: Event, now_ns: int, timing: Timing) -> Iterator[Event]:
        is_over = now_ns - suspect.newest_ns > QUIET_NS
        if not (is_over or suspect.updated_ns == 0 or now_ns - suspect.updated_ns >= SUMMARY_EVERY_NS):
            return
        phase = Phase.CLEARED if is_over else Phase.UPDATE if suspect.updated_ns else Phase.ONSET
        said = {"phase": phase, "detected_us": timing.detected_us, "count": suspect.counted}
        if phase is Phase.ONSET:
            yield summary.model_copy(update=said)
        else:
            assert suspect.newest is not None
            newest = replace(suspect.newest, deviation=suspect.deviation)
            of_summary = {"event_id": summary.event_id, "onset_us": summary.onset_us}
            yield event_message(newest, self._identity, timing).model_copy(update=said | of_summary)
        suspect.updated_ns = now_ns
        if is_over:
            suspect.summary, suspect.newest, suspect.deviation = None, None, (0.0, 0.0)
            suspect.counted, suspect.updated_ns = 0, 0
            suspect.summarised.clear()
