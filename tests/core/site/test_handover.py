"""A vehicle that goes from one engine to another with its state is judged as if it had stayed."""

from dataclasses import replace

import numpy as np
import pytest
from core.site.dense_road import dense_road
from core.traffic import START_US, Platoon, batch

from headway.core.engine import Engine
from headway.core.replay import replay
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import AnomalyEvent, Phase

CONFIG = DetectorConfig(vehicle_capacity=128)


def key(event: AnomalyEvent) -> AnomalyEvent:
    return replace(event, evidence=None)


def judged(road: list[Batch], engine: Engine) -> tuple[list[list[int]], list[AnomalyEvent]]:
    results = [engine.step(records) for records in road]
    return [result.outcomes.tolist() for result in results], [key(event) for r in results for event in r.events]


def with_rows_moved(capacity: int, before: int) -> Engine:
    """Return an engine whose next vehicles get rows in the opposite order, beside `before` vehicles far away."""
    engine = Engine(replace(CONFIG, vehicle_capacity=capacity))
    gone = [f"gone{i}" for i in range(100)]
    engine.step(batch(gone, np.arange(100) * -3e3, [0.0] * 100, [START_US - 60_000_000] * 100))
    engine.step(batch([], [], [], []), START_US - 20_000_000)
    assert engine.vehicles == 0
    others = [f"other{i}" for i in range(before)]
    engine.step(batch(others, np.arange(before) * -3e3 - 5e5, [0.0] * before, [START_US - 200_000] * before))
    return engine


@pytest.mark.parametrize(("capacity", "before"), [(128, 7), (300, 37)])
def test_what_a_vehicle_gets_does_not_depend_on_its_row(capacity: int, before: int) -> None:
    road = dense_road(cars=80, lanes=2, seconds=100.0)
    outcomes, events = judged(road, Engine(CONFIG))
    assert len({event.event_id for event in events if event.event_id.endswith("-link")}) >= 5
    other_outcomes, other_events = judged(road, with_rows_moved(capacity, before))
    assert other_outcomes == outcomes
    assert [event for event in other_events if not event.suspect.startswith("other")] == events


def transferred(engine: Engine, vehicles: list[str]) -> Engine:
    """Return another engine that took over these vehicles, in other rows."""
    other = Engine(replace(CONFIG, vehicle_capacity=200))
    other.step(batch([f"x{i}" for i in range(9)], np.arange(9) * -3e3 - 5e5, [0.0] * 9, [START_US] * 9))
    for vehicle in vehicles:
        state = engine.release(vehicle)
        assert state is not None
        assert other.adopt(state)
    return other


def test_another_engine_continues_with_all_vehicles_and_their_open_events() -> None:
    platoon = Platoon(6)
    engine = Engine(CONFIG)
    for _ in range(60):
        engine.step(platoon.next())
    opened = engine.step(platoon.next({"car2": 9.0})).events
    reference = Engine(CONFIG)
    again = Platoon(6)
    for _ in range(60):
        reference.step(again.next())
    reference.step(again.next({"car2": 9.0}))
    other = transferred(engine, platoon.ids)
    assert (engine.vehicles, engine.active_events, engine.open_event_ids) == (0, 0, set())
    assert (other.vehicles, other.open_event_ids) == (15, {opened[0].event_id})
    events = []
    for k in range(60):
        records = platoon.next({"car1": 7.0} if k == 30 else None)
        one, two = reference.step(records), other.step(records)
        assert one.outcomes.tolist() == two.outcomes.tolist() == [Outcome.SCORED] * 6
        assert one.nis.tobytes() == two.nis.tobytes()
        assert list(map(key, one.events)) == [key(e) for e in two.events if not e.suspect.startswith("x")]
        events += [e for e in two.events if not e.suspect.startswith("x")]
        for event in two.events:
            if event.evidence is not None:
                replayed = replay(event.evidence, CONFIG).by_filter[-1]
                assert float(replayed["statistic"]) == event.statistic
    assert {(e.event_id, e.phase) for e in events} >= {(opened[0].event_id, Phase.CLEARED)}


@pytest.mark.parametrize("seed", range(3))
def test_a_state_taken_up_again_at_any_time_changes_nothing(seed: int) -> None:
    road = dense_road(cars=40, lanes=2, seconds=90.0, seed=seed)
    outcomes, events = judged(road, Engine(CONFIG))
    rng, engine, found = np.random.default_rng(seed), Engine(CONFIG), []
    for k, records in enumerate(road):
        result = engine.step(records)
        assert result.outcomes.tolist() == outcomes[k]
        found += map(key, result.events)
        named = [event.follower for event in result.events]
        for vehicle in [*named, f"car{rng.integers(40)}"]:
            state = engine.release(vehicle)
            assert state is not None
            assert engine.adopt(state)
    assert found == events


def test_an_engine_that_judged_the_vehicle_for_its_neighbours_keeps_their_gaps() -> None:
    platoon = Platoon(4)
    one, two = Engine(CONFIG), Engine(CONFIG)
    for k in range(80):
        records = platoon.next()
        one.step(records)
        if k >= 20:  # the second engine has odometers of its own
            two.step(records, owned=np.array([False, True, True, True]))
    before = two.states()
    state = one.release("car0")
    assert state is not None
    assert two.adopt(state)
    after = two.states()
    assert after.followers == ["car0", *before.followers]
    assert after.gap_m[1:] == pytest.approx(before.gap_m, abs=1e-3)
    assert after.leaders[1:] == before.leaders == ["car0", "car1", "car2"]
    records = platoon.next()
    assert one.step(records, owned=np.array([False, True, True, True])).nis.size == 3
    assert two.step(records).outcomes.tolist() == [Outcome.SCORED] * 4


def test_a_full_engine_refuses_and_a_vehicle_that_is_not_known_has_no_state() -> None:
    platoon, full = Platoon(3), Engine(replace(CONFIG, vehicle_capacity=2))
    engine = Engine(CONFIG)
    engine.step(platoon.next())
    full.step(batch(["a", "b"], [0.0, 900.0], [0.0, 0.0], [START_US] * 2))
    state = engine.state_of("car1")
    assert state is not None
    assert not full.adopt(state)
    assert engine.release("nobody") is None
