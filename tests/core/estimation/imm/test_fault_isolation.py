"""Sensor and kind are read off the mode probabilities."""

import numpy as np
import pytest

from headway.core.estimation.imm.fault_isolation import fault_kind, faulty_sensor, isolate, isolate_ended
from headway.core.estimation.imm.modes import MODE_COUNT, Mode
from headway.core.types.records import Kind, Sensor


def probabilities(**given):
    mu = np.full(MODE_COUNT, 1e-10)
    for name, probability in given.items():
        mu[Mode[name]] = probability
    return mu


@pytest.mark.parametrize(
    ("given", "sensor"),
    [
        ({"POSITION_BIAS": 0.3, "POSITION_NOISE": 0.3, "SPEED_BIAS": 0.4}, Sensor.LOCATION),
        ({"POSITION_BIAS": 0.3, "SPEED_DRIFT": 0.2, "SPEED_NOISE": 0.2}, Sensor.SPEED),
        ({"POSITION_BIAS": 0.4, "POSITION_OFFSET": 0.3, "BOTH_NOISE": 0.2}, Sensor.BOTH),
    ],
)
def test_the_likeliest_set_of_sensors_is_isolated(given: dict[str, float], sensor: Sensor) -> None:
    assert faulty_sensor(probabilities(**given)) == sensor


def test_an_offset_of_the_other_sensor_means_noise_here() -> None:
    assert fault_kind(probabilities(SPEED_OFFSET=0.9, POSITION_BIAS=0.05, SPEED_BIAS=0.05), 0) == (
        Kind.NOISE,
        pytest.approx(0.947, abs=1e-3),
    )


def test_an_offset_beside_noise_is_divided_into_bias_and_drift() -> None:
    kind, confidence = fault_kind(probabilities(POSITION_OFFSET=0.6, POSITION_BIAS=0.1, POSITION_DRIFT=0.3), 0)
    assert kind == Kind.DRIFT
    assert confidence == pytest.approx(0.75)


def test_the_first_reading_is_short_and_later_ones_say_more() -> None:
    run_length = np.zeros(2, np.int64)
    mode_probability = probabilities(SPEED_BIAS=0.9, SPEED_NOISE=0.1)
    assert isolate(mode_probability, run_length, 0.1) == (Sensor.SPEED, Kind.SHORT, pytest.approx(0.1))
    assert isolate(mode_probability, run_length, 0.1) == (Sensor.SPEED, Kind.BIAS, pytest.approx(0.9))
    assert isolate(probabilities(POSITION_BIAS=1.0), run_length, 0.1)[:2] == (Sensor.LOCATION, Kind.SHORT)
    assert list(run_length) == [1, 0]


def test_a_fault_detected_only_as_it_ends_is_not_short() -> None:
    assert isolate_ended(probabilities(SPEED_DRIFT=0.8, SPEED_BIAS=0.2)) == (
        Sensor.SPEED,
        Kind.DRIFT,
        pytest.approx(0.8),
    )
