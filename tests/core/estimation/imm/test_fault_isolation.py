"""Names are read off the weights."""

import numpy as np
import pytest

from headway.core.estimation.imm.fault_isolation import fault_kind, faulty_sensor, isolate, isolate_ended
from headway.core.estimation.imm.modes import BIAS, BOTH, DRIFT, MODE_COUNT, NOISE, OTHER_PAIR, OTHER_SENSOR, PAIR
from headway.core.types.records import Kind, Sensor


def weights(**given):
    mode_probability = np.full(MODE_COUNT, 1e-10)
    for name, weight in given.items():
        place = {"BIAS": BIAS, "DRIFT": DRIFT, "NOISE": NOISE, "PAIR": PAIR, "BOTH": BOTH}[name.strip("_vx")]
        step = OTHER_PAIR if place == PAIR else OTHER_SENSOR
        mode_probability[place + (step if name.endswith("_v") else 0)] = weight
    return mode_probability


@pytest.mark.parametrize(
    ("given", "sensor"),
    [
        ({"BIAS_x": 0.3, "NOISE_x": 0.3, "BIAS_v": 0.4}, Sensor.LOCATION),
        ({"BIAS_x": 0.3, "DRIFT_v": 0.2, "NOISE_v": 0.2}, Sensor.SPEED),
        ({"BIAS_x": 0.4, "PAIR_x": 0.3, "BOTH": 0.2}, Sensor.BOTH),
    ],
)
def test_the_likeliest_set_of_sensors_is_blamed(given: dict[str, float], sensor: Sensor) -> None:
    assert faulty_sensor(weights(**given)) == sensor


def test_the_other_sensors_pair_means_noise_here() -> None:
    assert fault_kind(weights(PAIR_v=0.9, BIAS_x=0.05, BIAS_v=0.05), 0) == (Kind.NOISE, pytest.approx(0.947, abs=1e-3))


def test_ones_own_pair_is_shared_out_as_bias_and_drift() -> None:
    kind, confidence = fault_kind(weights(PAIR_x=0.6, BIAS_x=0.1, DRIFT_x=0.3), 0)
    assert kind == Kind.DRIFT
    assert confidence == pytest.approx(0.75)


def test_the_first_reading_is_short_and_later_ones_say_more() -> None:
    run_length = np.zeros(2, np.int64)
    mode_probability = weights(BIAS_v=0.9, NOISE_v=0.1)
    assert isolate(mode_probability, run_length, 0.1) == (Sensor.SPEED, Kind.SHORT, pytest.approx(0.1))
    assert isolate(mode_probability, run_length, 0.1) == (Sensor.SPEED, Kind.BIAS, pytest.approx(0.9))
    assert isolate(weights(BIAS_x=1.0), run_length, 0.1)[:2] == (Sensor.LOCATION, Kind.SHORT)
    assert list(run_length) == [1, 0]


def test_a_lie_told_of_only_as_it_ends_is_not_short() -> None:
    assert isolate_ended(weights(DRIFT_v=0.8, BIAS_v=0.2)) == (Sensor.SPEED, Kind.DRIFT, pytest.approx(0.8))
