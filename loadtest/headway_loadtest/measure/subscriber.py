"""Receives the alerts and the health of a site, with their receive times."""

import json
from collections import deque
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Self

import zenoh

from headway_loadtest.clock import Clock
from headway_loadtest.measure.accounting import Counters
from headway_schemas import Event, Keys, Kind, Phase, Sensor

WAITING_MAX = 50_000


@dataclass(slots=True)
class Episode:
    """One event from its onset to its end as the subscriber saw it. `received_ns` is monotonic, at the onset."""

    event_id: str
    received_ns: int
    kind: Kind
    sensor: Sensor
    suspect: str
    leader: str | None
    follower: str
    onset_us: int
    last_us: int
    cleared: bool = False


class Health(NamedTuple):
    """A health message as received. `content` may lack figures, so that an older service can be measured too."""

    received_ns: int
    instance: str
    counters: Counters
    content: dict[str, Any]

    @classmethod
    def read(cls, payload: bytes, received_ns: int) -> Self:
        """Read a payload. Raises ValueError, TypeError or KeyError where it is not the health of a service."""
        content = json.loads(payload)
        return cls(received_ns, content["instance"], Counters.of(content), content)


class _Message(NamedTuple):
    received_ns: int
    is_alert: bool
    payload: bytes


@dataclass(slots=True)
class Received:
    """All messages so far. `unread` counts those that could not be decoded or exceeded `WAITING_MAX`."""

    episodes: dict[str, Episode] = field(default_factory=dict)
    alerts: int = 0
    health: list[Health] = field(default_factory=list)
    unread: int = 0

    def alert(self, event: Event, received_ns: int) -> None:
        """Apply an event update: an onset opens an episode, the others prolong it; earlier episodes are ignored."""
        self.alerts += 1
        if event.phase is Phase.ONSET:
            self.episodes[event.event_id] = Episode(
                event_id=event.event_id,
                received_ns=received_ns,
                kind=event.kind,
                sensor=event.sensor,
                suspect=event.suspect,
                leader=event.leader,
                follower=event.follower,
                onset_us=event.t_us,
                last_us=event.t_us,
            )
        episode = self.episodes.get(event.event_id)
        if episode is None:
            return
        episode.kind, episode.sensor = event.kind, event.sensor
        episode.last_us = max(episode.last_us, event.t_us)
        episode.cleared = event.phase is Phase.CLEARED


class Subscriber:
    """Subscribes to the alerts and the health of a site; the callback only copies, `drain()` decodes."""

    def __init__(self, session: zenoh.Session, keys: Keys, clock: Clock) -> None:
        self.received = Received()
        self._clock = clock
        self._waiting: deque[_Message] = deque()
        self._subscribers = [
            session.declare_subscriber(keys.every_alert, lambda sample: self._receive(sample, is_alert=True)),
            session.declare_subscriber(keys.every_health, lambda sample: self._receive(sample, is_alert=False)),
        ]

    def drain(self) -> Received:
        """Decode what was received since the last call."""
        while self._waiting:
            received_ns, is_alert, payload = self._waiting.popleft()
            try:
                if is_alert:
                    self.received.alert(Event.model_validate_json(payload), received_ns)
                else:
                    self.received.health.append(Health.read(payload, received_ns))
            except (ValueError, TypeError, KeyError):
                self.received.unread += 1
        return self.received

    def close(self) -> None:
        """Unsubscribe."""
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _receive(self, sample: zenoh.Sample, *, is_alert: bool) -> None:
        if len(self._waiting) >= WAITING_MAX:
            self.received.unread += 1
            return
        self._waiting.append(_Message(self._clock.monotonic_ns(), is_alert, sample.payload.to_bytes()))
