"""Each event update of the engine, computed again from its evidence, bit for bit."""

from dataclasses import replace

import numpy as np
import pytest
from core.traffic import batch
from sim.faulty_platoon import NAMES, drive

from headway.core.engine import Engine
from headway.core.pipeline.detectors import build_detectors
from headway.core.replay import bank_row, replay
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Kind, Records, Sensor
from headway.core.types.step_result import AnomalyEvent, Phase

CONFIG = DetectorConfig(model="aekf", vehicle_capacity=8, warming_readings=20)


def events_of_a_drive(config: DetectorConfig, seed: int) -> list[AnomalyEvent]:
    engine, events = Engine(config), list[AnomalyEvent]()
    for now in drive(seed):
        leaders: list[str | None] = [None, *NAMES[:-1]]
        records = batch(NAMES, now.x_m, now.v_mps, [now.t_us] * 3, now.k % 128, leader_ids=leaders, range_m=now.range_m)
        events += engine.step(records, int(records.received_us.max())).events
    return events


def numbers_published(event: AnomalyEvent) -> tuple[float, ...]:
    return (event.nis, event.statistic, event.gate, event.p_value, *event.nu, *event.recovered)


def numbers_of(verdict: Records) -> tuple[float, ...]:
    names = ("x_m", "v_mps", "x_std_m", "v_std_mps")
    nu = verdict["nu"]
    judged = (verdict[name] for name in ("nis", "statistic", "gate", "p_value"))
    return (*map(float, judged), float(nu[0]), float(nu[1]), *(float(verdict[name]) for name in names))


@pytest.mark.parametrize(("model", "seed"), [("aekf", 1), ("aekf", 2), ("headway", 3)])
def test_each_event_update_is_replayed_bit_for_bit(model: str, seed: int) -> None:
    config = replace(CONFIG, model=model)
    events = [event for event in events_of_a_drive(config, seed) if event.evidence is not None]
    assert {event.sensor is Sensor.LINK for event in events} == {True, False}
    assert {event.phase for event in events} == set(Phase)
    for event in events:
        assert event.evidence is not None
        again = replay(event.evidence, config)
        verdict = (again.by_pair_tests if event.sensor is Sensor.LINK else again.by_filter)[-1]
        assert np.array(numbers_of(verdict)).tobytes() == np.array(numbers_published(event)).tobytes()
        if event.phase is not Phase.UPDATE:
            assert bool(verdict["anomalous"]) == (event.phase is Phase.ONSET)
        if verdict["anomalous"]:
            assert Sensor(int(verdict["sensor"])) is event.sensor
            assert Kind(int(verdict["kind"])) in (event.kind, Kind.SHORT)
        found = (bool(verdict["anomalous"]), Kind(int(verdict["kind"])), Sensor(int(verdict["sensor"])))
        is_own = event.phase is Phase.ONSET or found == (True, event.kind, event.sensor)
        if is_own and event.sensor is not Sensor.LINK:
            assert float(verdict["confidence"]) == event.confidence


def test_evidence_that_was_tampered_with_gives_another_verdict() -> None:
    event = next(event for event in events_of_a_drive(CONFIG, 1) if event.sensor is Sensor.LOCATION)
    assert event.evidence is not None
    readings = event.evidence.readings.copy()
    readings["x_m"][-1] = np.nextafter(readings["x_m"][-1], np.inf)
    again = replay(replace(event.evidence, readings=readings), CONFIG)
    assert numbers_of(again.by_filter[-1]) != numbers_published(event)


def test_a_checkpoint_comes_back_from_its_bytes() -> None:
    row = np.zeros((), build_detectors(CONFIG).dtype)
    row["model"]["count"] = 7
    assert bank_row(row.tobytes(), CONFIG).tobytes() == row.tobytes()
    with pytest.raises(ValueError, match="bytes, where a row of this version has"):
        bank_row(row.tobytes()[:-1], CONFIG)
