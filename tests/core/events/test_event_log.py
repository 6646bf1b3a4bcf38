"""The life of an event: one onset, updates when there is something new, one end."""

import numpy as np

from headway.core.events.event_log import CLEAR_AFTER_READINGS, EventLog
from headway.core.events.evidence import EvidenceStore
from headway.core.runtime import rows as banks
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import AnomalyEvent, Phase

STEP_US = 100_000


class Follower:
    """One vehicle whose verdicts the test dictates."""

    def __init__(self) -> None:
        vehicles = VehicleTable(1)
        [self.row] = vehicles.admit(["car"])
        bank = np.zeros(1, np.dtype([("count", "i8")]))
        self.log = EventLog(vehicles, EvidenceStore(bank, 8), 1)
        self.t_us = 1_000_000

    def reads(self, anomalous: bool, kind: Kind = Kind.SHORT, sensor: Sensor = Sensor.LOCATION) -> list[AnomalyEvent]:
        verdict = banks.verdicts(1)
        verdict["anomalous"] = anomalous
        if anomalous:
            verdict["kind"], verdict["sensor"], verdict["confidence"] = kind, sensor, 0.75
        self.t_us += STEP_US
        t_us = np.array([self.t_us])
        return self.log.update(np.array([self.row]), np.array([self.row]), np.array([-1]), t_us, t_us, verdict)


def test_clean_readings_cause_no_event() -> None:
    assert Follower().reads(False) == []


def test_onset_then_quiet_then_cleared_under_one_id() -> None:
    car = Follower()
    [onset] = car.reads(True)
    events = [event for _ in range(CLEAR_AFTER_READINGS) for event in car.reads(False)]
    assert [onset.phase] + [event.phase for event in events] == [Phase.ONSET, Phase.CLEARED]
    assert events[0].event_id == onset.event_id
    assert (events[0].kind, events[0].sensor) == (Kind.SHORT, Sensor.LOCATION)
    assert len(car.log) == 0
    assert car.reads(False) == []


def test_a_better_verdict_is_an_update_and_the_same_one_is_not() -> None:
    car = Follower()
    car.reads(True, Kind.SHORT)
    assert [car.reads(True, Kind.SHORT) for _ in range(2)] == [[], []]
    [update] = car.reads(True, Kind.BIAS)
    assert (update.phase, update.kind) == (Phase.UPDATE, Kind.BIAS)


def test_an_alternating_kind_is_updated_every_300_ms_at_10_hz() -> None:
    car = Follower()
    events = [car.reads(True, Kind.NOISE if n % 2 else Kind.BIAS) for n in range(13)]
    assert [n for n, update in enumerate(events) if update] == [0, 3, 6, 9, 12]
    assert [event.kind for update in events for event in update] == [
        Kind.BIAS, Kind.NOISE, Kind.BIAS, Kind.NOISE, Kind.BIAS
    ]  # fmt: skip


def test_a_change_too_soon_for_an_update_is_part_of_the_last_one() -> None:
    car = Follower()
    car.reads(True, Kind.SHORT)
    assert car.reads(True, Kind.BIAS, Sensor.SPEED) == []
    [cleared] = [event for _ in range(CLEAR_AFTER_READINGS) for event in car.reads(False)]
    assert (cleared.phase, cleared.kind, cleared.sensor) == (Phase.CLEARED, Kind.BIAS, Sensor.SPEED)


def test_a_long_event_is_restated_every_second() -> None:
    car = Follower()
    events = [event.phase for _ in range(25) for event in car.reads(True)]
    assert events == [Phase.ONSET, Phase.UPDATE, Phase.UPDATE]


def test_a_relapse_before_the_end_is_the_same_event() -> None:
    car = Follower()
    [onset] = car.reads(True)
    for _ in range(CLEAR_AFTER_READINGS - 1):
        assert car.reads(False) == []
    [update] = car.reads(True)
    assert (update.phase, update.event_id) == (Phase.UPDATE, onset.event_id)
    assert len(car.log) == 1
