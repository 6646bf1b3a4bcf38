"""The engine, from records to outcomes and events: the rules of conduct, one by one."""

from dataclasses import fields, replace

import numpy as np
import pytest
from core.traffic import LATENCY_US, START_US, STEP_US, Platoon, batch

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind, Sensor
from headway.core.types.step_result import AnomalyEvent, Phase, StepResult

CONFIG = DetectorConfig(model="ekf", delay_s=0.0, vehicle_capacity=16)
WARM = CONFIG.warming_readings + 1


def step(engine: Engine, records: Batch) -> StepResult:
    return engine.step(records, int(records.received_us.max()))


def labels(result: StepResult) -> list[str]:
    return [Outcome(code).label for code in result.outcomes]


def drive(engine: Engine, platoon: Platoon, steps: int) -> list[AnomalyEvent]:
    return [event for _ in range(steps) for event in step(engine, platoon.next()).events]


def one(name: str, t_us: int, x_m: float = 0.0) -> Batch:
    return batch([name], [x_m], [20.0], [t_us])


def test_a_vehicle_warms_up_and_is_then_scored() -> None:
    engine, platoon = Engine(CONFIG), Platoon(1)
    outcomes = [labels(step(engine, platoon.next()))[0] for _ in range(WARM + 5)]
    assert outcomes == ["warming"] * CONFIG.warming_readings + ["scored"] * 6


def test_a_platoon_is_paired_from_positions_and_its_clean_readings_cause_no_event() -> None:
    engine, platoon = Engine(CONFIG), Platoon(4)
    assert drive(engine, platoon, 50) == []
    states = engine.states()
    assert dict(zip(states.followers, states.leaders, strict=True)) == {
        "car0": None,
        "car1": "car0",
        "car2": "car1",
        "car3": "car2",
    }
    assert states.gap_m[1:] == pytest.approx(25.0 - 4.5, abs=0.2)
    assert engine.pairs == 3


def test_a_false_location_is_an_event_that_names_the_sensor_and_carries_its_evidence() -> None:
    engine, platoon = Engine(CONFIG), Platoon(3)
    drive(engine, platoon, 50)
    [onset] = step(engine, platoon.next({"car1": 8.0})).events
    assert (onset.phase, onset.sensor, onset.suspect) == (Phase.ONSET, Sensor.LOCATION, "car1")
    assert (onset.leader, onset.follower) == ("car0", "car1")
    assert onset.nu[0] == pytest.approx(8.0, abs=0.5)
    assert onset.nis > onset.gate
    assert onset.evidence is not None
    assert onset.evidence.readings["x_m"][-1] - onset.recovered[0] == pytest.approx(8.0, abs=0.5)
    cleared = drive(engine, platoon, 25)
    assert onset.kind is Kind.UNKNOWN
    assert [(event.phase, event.kind, event.event_id) for event in cleared] == [
        (Phase.UPDATE, Kind.SHORT, onset.event_id),
        (Phase.CLEARED, Kind.SHORT, onset.event_id),
    ]


def test_a_rejected_reading_is_not_passed_on_to_the_follower() -> None:
    engine, platoon = Engine(CONFIG), Platoon(2)
    drive(engine, platoon, 50)
    events = [event for _ in range(3) for event in step(engine, platoon.next({"car0": 30.0})).events]
    assert {event.suspect for event in events} == {"car0"}
    states = engine.states()
    assert states.x_m[1] == pytest.approx(states.x_m[0], abs=0.5)


def test_too_old_and_from_the_future_are_refused_and_leave_no_trace() -> None:
    engine = Engine(CONFIG)
    now = START_US
    result = engine.step(
        batch(["a", "b"], [0, 0], [1, 1], [now - 6_000_000, now + 2_000_000], received_us=[now, now]), now
    )
    assert labels(result) == ["too_old", "from_the_future"]
    assert engine.vehicles == 0


@pytest.mark.parametrize("ahead_us", [300_000, 950_000])
def test_a_message_from_ahead_does_not_refuse_the_next_ones(ahead_us: int) -> None:
    engine, platoon = Engine(CONFIG), Platoon(1)
    drive(engine, platoon, 50)
    for _ in range(10):
        ahead = one("car0", platoon.t_us + ahead_us, 1200.0)
        ahead = replace(ahead, received_us=np.array([platoon.t_us + LATENCY_US]))
        assert labels(step(engine, ahead)) == ["from_the_future"]
        assert [labels(step(engine, platoon.next()))[0] for _ in range(10)] == ["scored"] * 10


def test_a_sender_whose_clock_is_set_ahead_is_judged_again_within_seconds() -> None:
    engine, platoon = Engine(CONFIG), Platoon(1)
    drive(engine, platoon, 50)
    outcomes = []
    for _ in range(60):
        records = platoon.next()
        outcomes += labels(step(engine, replace(records, t_us=records.t_us + 900_000)))
    assert outcomes[0] == "from_the_future"
    assert set(outcomes[40:]) == {"scored"}


def test_a_burst_after_a_delay_is_judged_and_so_is_what_follows() -> None:
    engine, platoon = Engine(CONFIG), Platoon(1)
    drive(engine, platoon, 50)
    held = [platoon.next() for _ in range(40)]
    received_us = np.array([platoon.t_us])
    outcomes = [labels(engine.step(replace(one, received_us=received_us), platoon.t_us))[0] for one in held]
    assert outcomes == ["scored"] * 40
    assert [labels(step(engine, platoon.next()))[0] for _ in range(20)] == ["scored"] * 20


def test_duplicate_and_out_of_order_have_names() -> None:
    engine = Engine(CONFIG)
    step(engine, one("a", START_US))
    assert labels(step(engine, one("a", START_US))) == ["duplicate"]
    assert labels(step(engine, one("a", START_US - STEP_US))) == ["out_of_order"]


def test_records_of_one_vehicle_in_one_batch_are_taken_in_the_order_of_arrival() -> None:
    engine = Engine(CONFIG)
    times = [START_US + 2 * STEP_US, START_US, START_US + STEP_US, START_US]
    turn = engine.step(batch(["a"] * 4, [4, 0, 2, 0], [20] * 4, times), START_US + 3 * STEP_US)
    assert labels(turn) == ["warming", "out_of_order", "out_of_order", "out_of_order"]


def test_a_full_table_refuses_the_next_and_takes_it_when_others_are_forgotten() -> None:
    engine = Engine(replace(CONFIG, vehicle_capacity=2, vehicle_ttl_s=5.0))
    result = engine.step(batch(["a", "b", "c"], [0, 50, 90], [9] * 3, [START_US] * 3), START_US)
    assert sorted(labels(result)) == ["table_full", "warming", "warming"]
    later = START_US + 6_000_000
    assert engine.step(batch([], [], [], []), later).evicted == 2
    assert labels(engine.step(one("c", later), later)) == ["warming"]


def test_the_senders_counter_tells_of_missed_messages() -> None:
    engine, platoon = Engine(CONFIG), Platoon(1)
    drive(engine, platoon, 30)
    platoon.next()
    platoon.next()
    assert step(engine, platoon.next()).sequence_gaps == 2


def test_records_in_one_batch_give_what_they_give_one_by_one() -> None:
    whole, single = Engine(CONFIG), Engine(CONFIG)
    platoon = Platoon(6)
    for k in range(60):
        records = platoon.next({"car2": 5.0} if 40 <= k < 44 else None)
        together = step(whole, records)
        singles = [{f.name: getattr(records, f.name)[i : i + 1] for f in fields(Batch)} for i in range(len(records))]
        apart = [step(single, Batch(**columns)) for columns in singles]
        assert together.outcomes.tolist() == [int(one.outcomes[0]) for one in apart]
        separate = [event for one in apart for event in one.events]
        assert [(e.event_id, e.phase, e.nis) for e in together.events] == [
            (e.event_id, e.phase, e.nis) for e in separate
        ]


def test_an_event_is_cleared_when_its_vehicle_is_evicted() -> None:
    engine, platoon = Engine(CONFIG), Platoon(2)
    drive(engine, platoon, 50)
    [onset] = step(engine, platoon.next({"car1": 8.0})).events
    gone_us = onset.received_us + round((CONFIG.vehicle_ttl_s + 1) * 1e6)
    [cleared] = engine.step(batch([], [], [], []), gone_us).events
    assert (cleared.event_id, cleared.phase, cleared.suspect) == (onset.event_id, Phase.CLEARED, "car1")
    assert (cleared.t_us, cleared.evidence) == (onset.t_us, None)
    assert 0 <= cleared.detected_us - onset.received_us - CONFIG.vehicle_ttl_s * 1e6 <= 100_000


def test_silence_among_sending_neighbours_is_a_miss_after_a_second_until_the_next_message() -> None:
    engine, platoon = Engine(CONFIG), Platoon(3)
    drive(engine, platoon, 50)
    events = []
    for k in range(15):
        events += [(k, event) for event in step(engine, platoon.next(silent={"car1"})).events]
    [(k, onset)] = events
    assert 10 <= k <= 13  # ten messages may be lost on a channel that is not known yet
    assert (onset.kind, onset.suspect, onset.leader, onset.phase) == (Kind.MISS, "car1", "car0", Phase.ONSET)
    ended = [event for event in drive(engine, platoon, 3) if event.kind is Kind.MISS]
    assert [(event.phase, event.event_id) for event in ended] == [(Phase.CLEARED, onset.event_id)]


def test_a_gap_of_congestion_control_is_not_a_miss() -> None:
    engine, platoon = Engine(CONFIG), Platoon(2)
    drive(engine, platoon, 50)
    for _ in range(5):
        assert step(engine, platoon.next(silent={"car1"})).events == []
    assert drive(engine, platoon, 5) == []


def test_when_all_are_silent_it_is_our_own_ear() -> None:
    engine, platoon = Engine(CONFIG), Platoon(3)
    drive(engine, platoon, 50)
    platoon.k += 20
    assert engine.step(batch([], [], [], []), platoon.t_us).events == []
    assert drive(engine, platoon, 5) == []


def test_a_lone_vehicle_that_reappears_was_missed_if_others_were_received() -> None:
    engine, platoon, far = Engine(CONFIG), Platoon(1), Platoon(1, seed=2)
    far.ids = ["far"]
    for _ in range(40):
        records = far.next()
        step(engine, replace(records, lon_deg=records.lon_deg + 1.0))
        step(engine, platoon.next())
    for _ in range(15):
        records = far.next()
        assert step(engine, replace(records, lon_deg=records.lon_deg + 1.0)).events == []
        platoon.next()
    events = step(engine, platoon.next()).events
    assert [(event.kind, event.phase) for event in events] == [
        (Kind.MISS, Phase.ONSET),
        (Kind.MISS, Phase.CLEARED),
    ]


def test_a_change_of_pseudonym_is_not_a_miss() -> None:
    engine, platoon = Engine(CONFIG), Platoon(3)
    drive(engine, platoon, 50)
    for _ in range(15):
        events = step(engine, platoon.next(rename={"car1": "someone-else"})).events
        assert [event for event in events if event.kind is Kind.MISS] == []


def test_the_forgotten_leave_nothing_behind() -> None:
    engine, platoon = Engine(CONFIG), Platoon(3)
    drive(engine, platoon, 50)
    step(engine, platoon.next({"car1": 8.0}))
    later = platoon.t_us + 40_000_000
    assert engine.step(batch([], [], [], []), later).evicted == 3
    assert (engine.vehicles, engine.pairs, engine.active_events) == (0, 0, 0)
    assert engine.states().followers == []


def test_a_declared_leader_is_accepted() -> None:
    engine = Engine(CONFIG)
    for k in range(30):
        t = START_US + k * STEP_US
        x = [1000 + 2.0 * k, 940 + 2.0 * k]
        step(engine, batch(["lead", "me"], x, [20, 20], [t, t], k, leader_ids=[None, "lead"], range_m=[np.nan, 55.5]))
    assert engine.states().leaders == [None, "lead"]


def test_an_empty_batch_lets_time_pass() -> None:
    result = Engine(CONFIG).step(batch([], [], [], []), START_US)
    assert result.outcomes.size == 0
    assert result.events == []
