"""How far a patient attacker can teach the gate away: noise that grows slowly, and then an offset (ADR 0011)."""

import numpy as np
import pytest

from headway import Detector

TEACH_S, HIDDEN_S, CARS = 400.0, 2.0, 3
T0_US = 1_700_000_000_000_000


def suspects(sensor: str, noise: float, offset: float) -> tuple[set[str], set[str]]:
    """Return the cars with an event while their noise grows from 1 cm (or cm/s) to `noise`, and those with one after.

    Then `sensor` is off by `offset` for two seconds.
    """
    records = []
    for car in range(CARS):
        rng, t = np.random.default_rng([7, car]), np.arange(0.0, TEACH_S + 5.0, 0.1)
        v = 15.0 + 2.0 * np.sin(0.1 * t + car)
        x = 0.1 * (np.cumsum(v) - 0.5 * v)
        grown = 0.01 * (noise / 0.01) ** np.clip(t / (0.8 * TEACH_S), 0.0, 1.0)
        error = rng.normal(0.0, 1.0, t.size) * grown + offset * ((t >= TEACH_S) & (t < TEACH_S + HIDDEN_S))
        other = rng.normal(0.0, 0.01, t.size)
        x, v = (x + error, v + other) if sensor == "location" else (x + other, v + error)
        for k in range(t.size):
            record = {"v": 1, "id": f"car{car}", "msg_cnt": k % 128, "t_us": T0_US + round(1e6 * t[k])}
            place = {"lat": 40.0 + 0.3 * car + x[k] / 111_100.0, "lon": -83.0, "heading_deg": 0.0}
            records.append(record | place | {"speed_mps": max(0.02 * round(v[k] / 0.02), 0.0)})
    records.sort(key=lambda record: record["t_us"])
    detector = Detector()
    events = detector.process(records).events + detector.finish().events
    attacked_us = T0_US + round(1e6 * TEACH_S)
    teaching = {event.suspect for event in events if event.t_us < attacked_us}
    return teaching, {event.suspect for event in events if event.t_us >= attacked_us}


@pytest.mark.parametrize("sensor", ["location", "speed"])
def test_noise_that_raises_no_event_hides_no_offset_of_two(sensor: str) -> None:
    """Neither 2 m nor 2 m/s beside noise of 0.2."""
    teaching, found = suspects(sensor, noise=0.2, offset=2.0)
    assert teaching == set()
    assert len(found) == CARS


@pytest.mark.parametrize("sensor", ["location", "speed"])
def test_noise_that_would_hide_more_is_a_fault_itself(sensor: str) -> None:
    teaching, _ = suspects(sensor, noise=3.0, offset=0.0)
    assert len(teaching) == CARS
