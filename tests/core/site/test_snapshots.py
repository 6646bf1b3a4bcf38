"""An engine that goes on from another's snapshot gives the events that the first would have given."""

from dataclasses import replace

import numpy as np
import pytest
from core.traffic import Platoon, batch

from headway.core.engine import Engine
from headway.core.estimation.imm.step import KNOWN_WARMING_READINGS
from headway.core.replay import replay
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind
from headway.core.types.snapshot import concatenate
from headway.core.types.step_result import AnomalyEvent, Phase, StepResult

CONFIG = DetectorConfig(model="aekf", vehicle_capacity=16, warming_readings=20)


def step(engine: Engine, records: Batch) -> StepResult:
    return engine.step(records, int(records.received_us.max()))


def driven(steps: int, platoon: Platoon, config: DetectorConfig = CONFIG) -> Engine:
    engine = Engine(config)
    for _ in range(steps):
        step(engine, platoon.next())
    return engine


def restored(engine: Engine, now_us: int, stride: int = 1) -> Engine:
    other = Engine(CONFIG)
    other.restore(concatenate([engine.snapshot(stride, phase) for phase in range(stride)]), now_us)
    return other


def without_evidence(event: AnomalyEvent) -> AnomalyEvent:
    return replace(event, evidence=None)


@pytest.mark.parametrize("stride", [1, 4])
def test_the_restored_engine_continues_bit_for_bit(stride: int) -> None:
    platoon = Platoon(5)
    engine = driven(60, platoon)
    events = step(engine, platoon.next({"car2": 9.0})).events
    other = restored(engine, platoon.t_us, stride)
    assert (other.vehicles, other.pairs, other.active_events) == (5, 4, 1)
    for k in range(60):
        records = platoon.next({"car1": 7.0} if k == 30 else None)
        one, two = step(engine, records), step(other, records)
        assert one.outcomes.tolist() == two.outcomes.tolist() == [Outcome.SCORED] * 5
        assert one.nis.tobytes() == two.nis.tobytes()
        assert list(map(without_evidence, one.events)) == list(map(without_evidence, two.events))
        events += two.events
        for event in two.events:
            assert event.evidence is not None
            again = replay(event.evidence, CONFIG).by_filter[-1]
            assert (float(again["statistic"]), float(again["x_m"])) == (event.statistic, event.recovered[0])
    assert [(event.suspect, event.phase) for event in events] == [
        (car, phase) for car in ("car2", "car1") for phase in (Phase.ONSET, Phase.UPDATE, Phase.CLEARED)
    ]


def test_after_a_short_absence_vehicles_are_known_and_none_is_missed() -> None:
    platoon = Platoon(4)
    engine = driven(60, platoon)
    platoon.k += 30
    other = restored(engine, platoon.t_us)
    events = []
    for k in range(20):
        result = step(other, platoon.next(silent={"car2"} if k < 3 else None))
        events += result.events
        assert set(result.outcomes) == {Outcome.SCORED}
    assert [event for event in events if event.kind is Kind.MISS] == []


AWAY = 900
"""Steps, each of 0.1 s: more than `max_gap_s` and `vehicle_ttl_s`."""


def test_after_a_long_absence_vehicles_are_judged_within_a_second_by_what_was_learnt_of_them() -> None:
    platoon, config = Platoon(4), DetectorConfig(vehicle_capacity=16)
    engine = driven(300, platoon, config)
    learnt = engine.qualities()
    platoon.k += AWAY
    other = Engine(config)
    other.restore(engine.snapshot(), platoon.t_us)
    outcomes, events = [], []
    for k in range(100):
        result = step(other, platoon.next({"car2": 20.0} if 10 <= k < 20 else None))
        outcomes.append(set(result.outcomes.tolist()))
        events += result.events
        if k == 0:
            kept = other.qualities()
    assert outcomes == [{Outcome.WARMING}] * KNOWN_WARMING_READINGS + [{Outcome.SCORED}] * (
        100 - KNOWN_WARMING_READINGS
    )
    assert {(event.suspect, event.phase) for event in events} == {("car2", phase) for phase in Phase}
    onset = events[0]
    assert onset.evidence is not None
    again = replay(onset.evidence, config).by_filter[-1]
    assert (float(again["statistic"]), float(again["x_m"])) == (onset.statistic, onset.recovered[0])
    for name in ("position_noise_m", "speed_noise_mps", "speed_scale"):
        before, after = getattr(learnt.qualities, name), getattr(kept.qualities, name)
        np.testing.assert_array_equal(after, before)


def test_a_vehicle_that_was_away_itself_is_not_known_any_more() -> None:
    config = DetectorConfig(vehicle_capacity=16, vehicle_ttl_s=1e4)
    platoon = Platoon(2)
    engine = driven(100, platoon, config)
    for k in range(AWAY + 40):
        result = step(engine, platoon.next(silent={"car1"} if k < AWAY else None))
        if k >= AWAY:
            warming = Outcome.WARMING if k < AWAY + config.warming_readings else Outcome.SCORED
            assert result.outcomes.tolist() == [Outcome.SCORED, warming]


def test_a_vehicle_that_falls_silent_after_the_restart_is_missed() -> None:
    platoon = Platoon(3)
    other = restored(driven(60, platoon), platoon.t_us)
    step(other, platoon.next())
    events = [event for _ in range(15) for event in step(other, platoon.next(silent={"car1"})).events]
    assert [(event.kind, event.suspect) for event in events] == [(Kind.MISS, "car1")]


def test_the_time_without_a_service_is_no_silence() -> None:
    platoon = Platoon(3)
    engine, hour_us, ttl_us = driven(60, platoon), 3_600_000_000, int(CONFIG.vehicle_ttl_s * 1e6)
    late = platoon.t_us + hour_us
    other = restored(engine, late)
    nothing = batch([], [], [], [])
    assert other.step(nothing, late + ttl_us).evicted == 0
    assert other.step(nothing, late + ttl_us + 200_000).evicted == 3


def test_a_vehicle_silent_for_too_long_before_the_snapshot_is_not_restored() -> None:
    platoon = Platoon(3)
    parts = [driven(60, Platoon(2, seed=2)).snapshot(), driven(60, platoon).snapshot()]
    parts[0].tables["tracks"]["received_us"] -= int(CONFIG.vehicle_ttl_s * 1e6) + 1
    both = concatenate([replace(parts[0], rows=parts[0].rows + 4, ids=["old", "older"]), parts[1]])
    assert Engine(CONFIG).restore(both, platoon.t_us) == 3


def test_a_vehicle_that_changed_its_row_between_two_parts_is_known_once() -> None:
    platoon = Platoon(3)
    engine = driven(30, platoon)
    early = engine.snapshot(2, 0)
    later = driven(60, Platoon(2, seed=2))
    late = later.snapshot(2, 1)
    both = concatenate([replace(early, rows=early.rows + 4), late])
    assert sorted(both.ids) == ["car0", "car1", "car2"]
    both = replace(both, ids=["car1" if name == "car2" else name for name in both.ids])
    other = Engine(CONFIG)
    assert other.restore(both, platoon.t_us) == 2
    assert sorted(other.states().followers) == ["car0", "car1"]


def test_a_leader_that_was_not_restored_leads_no_one() -> None:
    platoon = Platoon(3)
    engine = driven(60, platoon)
    alone = engine.snapshot()
    keep = np.array([alone.ids.index("car2")])
    part = replace(
        alone, rows=alone.rows[keep], ids=["car2"], tables={name: t[keep] for name, t in alone.tables.items()}
    )
    other = Engine(CONFIG)
    other.restore(part, platoon.t_us)
    assert other.pairs == 0
    newcomers = batch(["x", "y"], [0.0, 900.0], [20.0, 20.0], [platoon.t_us] * 2)
    step(other, newcomers)
    assert other.pairs == 0
