"""A recording through the service's engine in the order of reception, and the alarms that come of it."""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway_loadtest.evaluate.field.recordings import Recording, Records
from headway_loadtest.sources.drive import F64

STEP_US = 100_000
"""Messages of so long a time are one batch; the service looks for silence as often."""
SILENCE_US = 40_000_000
"""Time passes for the engine through so much of a silence of everybody: longer, and it knows nobody any more."""
FINISH_US = 5_000_000
"""Time that passes after the last message, so that open events end."""
CLEAR_US = 2_000_000
"""An event is cleared so long after its last alarm."""
ROOM = 2
"""Rows of the engine's tables for each vehicle of the recording."""


@dataclass(frozen=True, slots=True)
class EventUpdate:
    """One published step of an event. `is_alarm` is False for the one that clears it."""

    t_us: int
    kind: str
    sensor: str
    suspect: str
    is_alarm: bool
    observations: tuple[str, ...] = ()
    """Physical limits that the vehicle's messages break at that time."""


@dataclass(frozen=True, slots=True)
class Alarm:
    """One event id from onset to cleared; times are event times."""

    event_id: str
    follower: str
    leader: str | None
    updates: list[EventUpdate] = field(default_factory=list)

    @property
    def start_us(self) -> int:
        """Time of the onset."""
        return self.updates[0].t_us

    def alarmed_until_us(self, end_us: int) -> int:
        """Time of the last alarming reading; `end_us` where the event was never cleared."""
        last = self.updates[-1]
        if last.is_alarm:
            return end_us
        updated_us = max((update.t_us for update in self.updates if update.is_alarm), default=self.start_us)
        return max(updated_us, last.t_us - CLEAR_US)

    def open_until_us(self, end_us: int) -> int:
        """Time at which it is cleared; `end_us` where it never was."""
        last = self.updates[-1]
        return end_us if last.is_alarm else last.t_us

    @property
    def newest(self) -> EventUpdate:
        """The newest update that does not clear the event."""
        return next((update for update in reversed(self.updates) if update.is_alarm), self.updates[-1])

    @property
    def observations(self) -> set[str]:
        """Every physical limit that was broken."""
        return {name for update in self.updates for name in update.observations}

    @property
    def suspects(self) -> set[str]:
        """Every vehicle that was named."""
        return {update.suspect for update in self.updates}


@dataclass(frozen=True, slots=True)
class Detection:
    """What came of a recording. `pair_hours`: time in which vehicles followed others, summed over followers."""

    alarms: tuple[Alarm, ...]
    pair_hours: float
    end_us: int
    """Event time of the last message."""


def detect(recording: Recording, budget_per_hour: float) -> Detection:
    """Take the messages through an engine of their own, batch by batch, as the service would."""
    messages = recording.messages
    room = max(64, ROOM * len(recording.vehicles))
    engine = Engine(DetectorConfig(alarm_budget_per_hour=budget_per_hour, vehicle_capacity=room))
    ids = np.array([name.encode() for name in recording.vehicles], "S64")
    alarms: dict[str, Alarm] = {}
    pair_us = 0
    for start, stop, now_us in _steps(messages):
        result = engine.step(_batch(messages[start:stop], ids), now_us)
        pair_us += engine.pairs * STEP_US
        for event in result.events:
            alarm = alarms.setdefault(event.event_id, Alarm(event.event_id, event.follower, event.leader))
            alarm.updates.append(
                EventUpdate(
                    t_us=event.t_us,
                    kind=event.kind.label,
                    sensor=event.sensor.label,
                    suspect=event.suspect,
                    is_alarm=event.phase.value != "cleared",
                    observations=event.observations,
                )
            )
    return Detection(tuple(alarms.values()), pair_us / 3.6e9, int(messages["t_us"].max()))


def _steps(messages: Records) -> Iterator[tuple[int, int, int]]:
    """Yield slices of the messages with the receive time of each; empty ones while nobody sends."""
    received_us = messages["received_us"]
    slots = received_us // STEP_US
    starts = np.flatnonzero(np.r_[True, np.diff(slots) > 0])
    stops = np.r_[starts[1:], len(messages)]
    before_us = int(received_us[0])
    for start, stop in zip(starts.tolist(), stops.tolist(), strict=True):
        now_us = int(received_us[stop - 1])
        until_us = min(int(received_us[start]), before_us + SILENCE_US)
        yield from ((start, start, t) for t in range(before_us + STEP_US, until_us - STEP_US // 2, STEP_US))
        yield start, stop, now_us
        before_us = now_us
    n = len(messages)
    yield from ((n, n, t) for t in range(before_us + STEP_US, before_us + FINISH_US, STEP_US))


def _batch(messages: Records, ids: np.ndarray[tuple[int], np.dtype[np.bytes_]]) -> Batch:
    n = len(messages)
    absent: F64 = np.full(n, np.nan)
    columns = {name: np.ascontiguousarray(messages[name]) for name in messages.dtype.names or () if name != "vehicle"}
    return Batch(
        ids=ids[messages["vehicle"]], leader_ids=np.zeros(n, "S64"), range_m=absent, range_rate_mps=absent, **columns
    )
