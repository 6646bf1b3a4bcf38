"""The life of an event: one onset, updates when there is something new, one end."""

import numpy as np

from headway.core.events.event_log import CLEAR_AFTER_READINGS, EventLog
from headway.core.events.evidence import EvidenceStore, store_readings
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
        self.bank = np.zeros(1, np.dtype([("count", "i8")]))
        self.evidence = EvidenceStore(self.bank, 8)
        self.log = EventLog(vehicles, self.evidence, 1)
        self.t_us = 1_000_000

    def reads(
        self, anomalous: bool, kind: Kind = Kind.SHORT, sensor: Sensor = Sensor.LOCATION, x_m: float = 0.0
    ) -> list[AnomalyEvent]:
        """Return the events of a reading of `x_m`, where the estimate is 0."""
        reading = banks.readings(1)
        reading["x_m"] = x_m
        store_readings(self.evidence.tables, np.array([self.row]), reading, np.array([-1]))
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
    assert (onset.phase, onset.kind) == (Phase.ONSET, Kind.UNKNOWN)
    assert [(event.phase, event.kind) for event in events] == [(Phase.UPDATE, Kind.SHORT), (Phase.CLEARED, Kind.SHORT)]
    assert {(event.event_id, event.sensor) for event in (onset, *events)} == {(onset.event_id, Sensor.LOCATION)}
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
    update, cleared = [event for _ in range(CLEAR_AFTER_READINGS) for event in car.reads(False)]
    assert (update.phase, update.kind, update.sensor) == (Phase.UPDATE, Kind.BIAS, Sensor.SPEED)
    assert (cleared.phase, cleared.kind, cleared.sensor) == (Phase.CLEARED, Kind.BIAS, Sensor.SPEED)


def test_a_long_event_is_restated_every_second() -> None:
    car = Follower()
    events = [event.phase for _ in range(25) for event in car.reads(True)]
    assert events == [Phase.ONSET, Phase.UPDATE, Phase.UPDATE]


def test_a_relapse_before_the_end_is_the_same_event() -> None:
    car = Follower()
    events = car.reads(True)
    for _ in range(CLEAR_AFTER_READINGS - 1):
        events += car.reads(False)
    for _ in range(3):
        events += car.reads(True)
    assert [event.phase for event in events] == [Phase.ONSET, Phase.UPDATE, Phase.UPDATE]
    assert len({event.event_id for event in events}) == 1
    assert len(car.log) == 1


def test_the_deviation_is_the_largest_until_now() -> None:
    car = Follower()
    [onset] = car.reads(True, x_m=0.5)
    events = [event for n in range(12) for event in car.reads(True, x_m=-3.0 if n == 4 else 1.0)]
    assert onset.deviation == (0.5, 0.0)
    assert [event.deviation for event in events] == [(3.0, 0.0)]
    cleared = [event for _ in range(CLEAR_AFTER_READINGS) for event in car.reads(False, x_m=4.0)][-1]
    assert (cleared.phase, cleared.deviation, cleared.onset_us) == (Phase.CLEARED, (4.0, 0.0), onset.t_us)


def test_an_end_has_the_confidence_of_the_last_alarm_of_its_kind() -> None:
    car = Follower()
    for kind in (Kind.UNKNOWN, Kind.BIAS, Kind.SHORT):
        car.reads(True, kind)
    assert [event.confidence for _ in range(CLEAR_AFTER_READINGS) for event in car.reads(False)] == [0.75, 0.75]


class Pair:
    """A leader and its follower, with the log of their own events and that of the pair tests."""

    def __init__(self) -> None:
        self.vehicles = VehicleTable(2)
        self.leader, self.follower = self.vehicles.admit(["a", "b"])
        evidence = EvidenceStore(np.zeros(2, np.dtype([("count", "i8")])), 8)
        store_readings(evidence.tables, np.arange(2), banks.readings(2), np.array([-1, 0]))
        self.own, self.pair = (EventLog(self.vehicles, evidence, 2, suffix) for suffix in ("", "-link"))
        self.t_us = 1_000_000

    def reads(self, log: EventLog, row: int, suspect: int, kind: Kind, sensor: Sensor) -> list[AnomalyEvent]:
        verdict = banks.verdicts(1)
        verdict["anomalous"], verdict["kind"], verdict["sensor"] = kind is not Kind.NONE, kind, sensor
        self.t_us += STEP_US
        t_us, leader = np.array([self.t_us]), np.array([self.leader if row == self.follower else -1])
        if log is self.own:
            log.take_over(self.pair, np.array([row])[verdict["anomalous"]])
        return log.update(np.array([row]), np.array([suspect]), leader, t_us, t_us, verdict)


def test_a_fault_of_the_suspect_continues_the_event_of_the_pair() -> None:
    cars = Pair()
    [onset] = cars.reads(cars.pair, cars.follower, cars.leader, Kind.RESPONSE, Sensor.LINK)
    for _ in range(3):
        updates = cars.reads(cars.own, cars.leader, cars.leader, Kind.BIAS, Sensor.SPEED)
    assert [(event.event_id, event.kind, event.suspect) for event in updates] == [(onset.event_id, Kind.BIAS, "a")]
    assert (len(cars.pair), len(cars.own)) == (0, 1)


def test_a_fault_of_the_other_one_is_an_event_of_its_own() -> None:
    cars = Pair()
    cars.reads(cars.pair, cars.follower, cars.follower, Kind.RESPONSE, Sensor.LINK)
    [onset] = cars.reads(cars.own, cars.leader, cars.leader, Kind.BIAS, Sensor.SPEED)
    assert (onset.phase, onset.suspect) == (Phase.ONSET, "a")
    assert (len(cars.pair), len(cars.own)) == (1, 1)


def test_a_changed_suspect_is_an_update() -> None:
    cars = Pair()
    cars.reads(cars.pair, cars.follower, cars.follower, Kind.RESPONSE, Sensor.LINK)
    for _ in range(3):
        updates = cars.reads(cars.pair, cars.follower, cars.leader, Kind.RESPONSE, Sensor.LINK)
    assert [(event.phase, event.suspect, event.deviation) for event in updates] == [(Phase.UPDATE, "a", (0.0, 0.0))]


def test_the_end_names_the_suspect_of_the_last_alarm() -> None:
    cars = Pair()
    cars.reads(cars.pair, cars.follower, cars.leader, Kind.RESPONSE, Sensor.LINK)
    for _ in range(CLEAR_AFTER_READINGS):
        ends = cars.reads(cars.pair, cars.follower, cars.follower, Kind.NONE, Sensor.LINK)
    assert [(event.phase, event.suspect) for event in ends] == [(Phase.CLEARED, "a")]


def test_an_event_explains_what_its_neighbours_do_until_five_seconds_after_it() -> None:
    cars = Pair()
    rows, none = np.array([cars.leader]), np.array([-1])

    def explained(after_s: float) -> tuple[bool, bool]:
        t_us = np.array([cars.t_us + int(after_s * 1e6)])
        return bool(cars.own.explains(rows, t_us)[0]), bool(cars.own.explains(none, t_us)[0])

    cars.t_us += 100_000_000
    assert explained(0.0) == (False, False)
    cars.reads(cars.own, cars.leader, cars.leader, Kind.BIAS, Sensor.SPEED)
    assert explained(100.0) == (True, False)
    for _ in range(CLEAR_AFTER_READINGS):
        cars.reads(cars.own, cars.leader, cars.leader, Kind.NONE, Sensor.NONE)
    assert explained(4.9) == (True, False)
    assert explained(5.1) == (False, False)
