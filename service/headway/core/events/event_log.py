"""From verdicts to events: onset, update, cleared; at most one open event for each vehicle, with one id throughout.

A first reading beyond the gate does not say whether more follow, so an onset does not call a fault short. An update
with the kind follows as soon as the next readings show it.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.events.evidence import EvidenceStore
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import I64
from headway.core.types.records import Kind, Observation, Records, Sensor
from headway.core.types.snapshot import OpenEvent
from headway.core.types.step_result import AnomalyEvent, Phase

CLEAR_AFTER_READINGS = 20
"""Readings below the gate in a row that end an event: two seconds at 10 Hz, so one cause is one event."""

UPDATE_EVERY_US = 1_000_000

EXPLAINS_US = 5_000_000
"""For so long after a vehicle's event its neighbours still respond to what it sent."""

CHANGE_AFTER_US = 250_000
"""Least time between an event update and one with another kind or sensor: the kind of some faults alternates."""


@dataclass(slots=True)
class _Open:
    """An open event."""

    event_id: str
    onset_us: int
    suspect: int
    kind: Kind
    sensor: Sensor
    """Suspect (a row), kind and sensor are those of the newest alarm, published or not."""
    updated_us: int
    changed: bool = False
    readings_below_gate: int = 0
    kind_published: bool = False
    deviation: tuple[float, float] = (0.0, 0.0)
    """Largest |reading - estimate| of location (m) and speed (m/s)."""
    confidence: float = math.nan
    """That of the newest alarm of this kind and sensor."""


class _Subject(NamedTuple):
    """The vehicles of a verdict, as rows (leader -1: none), and its times."""

    row: int
    suspect: int
    leader: int
    t_us: int
    received_us: int


class EventLog:
    """Open events by row. `suffix` distinguishes the event ids of several logs."""

    def __init__(self, vehicles: VehicleTable, evidence: EvidenceStore, capacity: int, suffix: str = "") -> None:
        self._suffix = suffix
        self._vehicles = vehicles
        self._evidence = evidence
        self._open: dict[int, _Open] = {}
        self.active: NDArray[np.bool_] = np.zeros(capacity, np.bool_)
        self.suspects: I64 = np.full(capacity, -1)
        """(C,) row of the suspect of each open event; -1 without one."""
        self._cleared_us = np.zeros(capacity, np.int64)

    def __len__(self) -> int:
        """Return the number of open events."""
        return len(self._open)

    def update(
        self, rows: I64, suspects: I64, leaders: I64, t_us: I64, received_us: I64, verdicts: Records
    ) -> list[AnomalyEvent]:
        """Update the log with one verdict for each of the distinct `rows` (n,), and return the event updates.

        `suspects` (n,) are the rows of the suspects, each the row itself or its leader; `leaders` is -1 for none.
        """
        concerned = np.flatnonzero(verdicts["anomalous"] | self.active[rows])
        subjects = zip(
            *(column[concerned].tolist() for column in (rows, suspects, leaders, t_us, received_us)), strict=True
        )
        findings = zip(*(verdicts[name][concerned].tolist() for name in ("anomalous", "kind", "sensor")), strict=True)
        events = []
        for i, of, (anomalous, kind, sensor) in zip(concerned, map(_Subject._make, subjects), findings, strict=True):
            phase = self._advance(of, kind, sensor, anomalous=anomalous)
            self._note(of.row, verdicts[i], anomalous=anomalous)
            if phase is not None:
                events.append(self._event(phase, of, verdicts[i]))
            if phase is Phase.CLEARED:
                self._cleared_us[of.row] = of.t_us
                self.drop(of.row)
        return events

    def explains(self, rows: I64, t_us: I64) -> NDArray[np.bool_]:
        """Return (n,) whether an event of each row, -1 for none, is open or ended so recently that it lasts on."""
        return (rows >= 0) & (self.active[rows] | (t_us - self._cleared_us[rows] < EXPLAINS_US))

    def take_over(self, other: "EventLog", rows: I64) -> None:
        """Continue events of another log that suspect any of `rows` (n,), where this one has none yet."""
        wanted = set(rows[~self.active[rows]].tolist()) if len(other) else set()
        for event in other.release(wanted):
            self._set(event.suspect, event)

    def release(self, suspects: set[int]) -> list[_Open]:
        """Close the newest event that names each of `suspects` (rows), without an event update, and return them."""
        released = {event.suspect: row for row, event in self._open.items() if event.suspect in suspects}
        events = [self._open[row] for row in released.values()]
        for row in released.values():
            self.drop(row)
        return events

    def of(self, rows: I64) -> list[int]:
        """Return the rows of the open events that concern any of `rows` (n,), as the row itself or as the suspect."""
        concerned = self.active & (np.isin(np.arange(self.active.size), rows) | np.isin(self.suspects, rows))
        found: list[int] = np.flatnonzero(concerned).tolist()
        return found

    def end(self, row: int, t_us: int, received_us: int, now_us: int) -> AnomalyEvent:
        """Close the event of a row before a vehicle is evicted; its last message was of `t_us`."""
        event = self._open[row]
        follower, suspect = self._vehicles.id_of[row], self._vehicles.id_of[event.suspect]
        assert follower is not None
        assert suspect is not None
        self.drop(row)
        return AnomalyEvent(
            event_id=event.event_id,
            phase=Phase.CLEARED,
            kind=event.kind,
            sensor=event.sensor,
            confidence=event.confidence,
            suspect=suspect,
            leader=None,
            follower=follower,
            t_us=t_us,
            onset_us=event.onset_us,
            received_us=received_us,
            detected_us=now_us,
            deviation=event.deviation,
        )

    def cleared_us(self, row: int) -> int:
        """Return the event time at which the newest event of a row ended; 0: none did."""
        return int(self._cleared_us[row])

    def replace(self, row: int, event: OpenEvent | None, cleared_us: int) -> None:
        """Set the open event of a row, and when the one before ended, without an event update."""
        self.drop(row)
        self._cleared_us[row] = cleared_us
        self.restore([event] if event is not None else [])

    def evict(self, row: int) -> None:
        """Forget a row, without an event update."""
        self.drop(row)
        self._cleared_us[row] = 0

    def drop(self, row: int) -> None:
        """Close the event of a row, if any, without an event update."""
        self._open.pop(row, None)
        self.active[row] = False
        self.suspects[row] = -1

    def _set(self, row: int, event: _Open) -> None:
        self._open[row] = event
        self.active[row] = True
        self.suspects[row] = event.suspect

    def snapshot(self, rows: I64) -> list[OpenEvent]:
        """Return the open events of `rows` (n,)."""
        of = [(int(row), self._open[int(row)]) for row in rows[self.active[rows]]]
        return [
            OpenEvent(
                row,
                e.event_id,
                e.suspect,
                e.onset_us,
                int(e.kind),
                int(e.sensor),
                e.updated_us,
                e.changed,
                e.readings_below_gate,
                e.kind_published,
                *e.deviation,
                e.confidence,
            )
            for row, e in of
        ]

    def restore(self, events: list[OpenEvent]) -> None:
        """Open these events without an event update."""
        for event in events:
            restored = _Open(
                event.event_id,
                event.onset_us,
                event.suspect,
                Kind(event.kind),
                Sensor(event.sensor),
                event.updated_us,
                event.changed,
                event.readings_below_gate,
                event.kind_published,
                (event.deviation_m, event.deviation_mps),
                event.confidence,
            )
            self._set(event.row, restored)

    def _note(self, row: int, verdict: np.void, *, anomalous: bool) -> None:
        """Take note of the confidence of an alarm, and of the deviation of each reading."""
        event = self._open[row]
        if anomalous and (int(verdict["kind"]), int(verdict["sensor"])) == (event.kind, event.sensor):
            event.confidence = float(verdict["confidence"])
        if event.sensor is Sensor.LINK:
            return
        reading = self._evidence.newest(row)
        event.deviation = (
            max(event.deviation[0], abs(float(reading["x_m"] - verdict["x_m"]))),
            max(event.deviation[1], abs(float(reading["v_mps"] - verdict["v_mps"]))),
        )

    def _advance(self, of: _Subject, kind: int, sensor: int, *, anomalous: bool) -> Phase | None:
        row, t_us = of.row, of.t_us
        event = self._open.get(row)
        if event is None:
            event_id = f"{self._vehicles.id_of[row]}-{t_us}{self._suffix}"
            is_known = Kind(kind) not in (Kind.SHORT, Kind.UNKNOWN)
            self._set(row, _Open(event_id, t_us, of.suspect, Kind(kind), Sensor(sensor), t_us, kind_published=is_known))
            return Phase.ONSET
        if not anomalous:
            event.readings_below_gate += 1
            if event.kind is Kind.UNKNOWN:
                event.kind = Kind.SHORT  # over before anything else was known of it
            if event.readings_below_gate >= CLEAR_AFTER_READINGS:
                return Phase.CLEARED
            return self._publish(event, t_us) if not event.kind_published else None
        event.readings_below_gate = 0
        if kind == Kind.SHORT and event.kind is not Kind.UNKNOWN:
            kind = event.kind  # one more odd reading of a fault that is known already
        if (kind, sensor, of.suspect) != (event.kind, event.sensor, event.suspect):
            event.kind, event.sensor, event.suspect, event.changed = Kind(kind), Sensor(sensor), of.suspect, True
            self.suspects[row] = of.suspect
        if t_us - event.updated_us < (CHANGE_AFTER_US if event.changed else UPDATE_EVERY_US):
            return None
        return self._publish(event, t_us)

    @staticmethod
    def _publish(event: _Open, t_us: int) -> Phase:
        event.updated_us, event.changed, event.kind_published = t_us, False, event.kind is not Kind.UNKNOWN
        return Phase.UPDATE

    def _event(self, phase: Phase, of: _Subject, verdict: np.void) -> AnomalyEvent:
        event = self._open[of.row]
        follower, suspect = self._vehicles.id_of[of.row], self._vehicles.id_of[event.suspect]
        assert follower is not None
        assert suspect is not None
        return AnomalyEvent(
            event_id=event.event_id,
            phase=phase,
            kind=event.kind if event.kind_published or phase is Phase.CLEARED else Kind.UNKNOWN,
            sensor=event.sensor,
            confidence=event.confidence,
            suspect=suspect,
            leader=self._vehicles.id_of[of.leader] if of.leader >= 0 else None,
            follower=follower,
            t_us=of.t_us,
            onset_us=event.onset_us,
            received_us=of.received_us,
            detected_us=of.received_us,
            nis=float(verdict["nis"]),
            gate=float(verdict["gate"]),
            statistic=float(verdict["statistic"]),
            p_value=float(verdict["p_value"]),
            nu=(float(verdict["nu"][0]), float(verdict["nu"][1])),
            recovered=(
                float(verdict["x_m"]),
                float(verdict["v_mps"]),
                float(verdict["x_std_m"]),
                float(verdict["v_std_mps"]),
            ),
            deviation=event.deviation,
            observations=_observations(int(verdict["observed"])),
            evidence=self._evidence.of(of.row),
        )


def _observations(observed: int) -> tuple[str, ...]:
    return tuple(one.label for one in Observation(observed))
