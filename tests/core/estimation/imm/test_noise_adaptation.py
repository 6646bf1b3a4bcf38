"""Adapted noise converges from any start, on readings of known noise."""

import numpy as np
import pytest
from numba import njit

from headway.core.estimation.imm.step import headway_dtype, headway_params, step_row
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

CONFIG = DetectorConfig()
P = headway_params(CONFIG)


@njit
def drive(row, read, p, results):
    for k in range(read.size):
        step_row(row, read[k], p, results[k])


def learnt(rng, x_std, v_std, jerk_std=0.8, speed_bias_mps=0.0, lag_s=0.0, n=3000):
    """Return the adapted noise after five minutes of a car whose acceleration wanders."""
    h = 0.1
    a = np.zeros(n)
    for k in range(1, n):
        a[k] = 0.995 * a[k - 1] + np.sqrt(h) * jerk_std * rng.normal() * 0.5
    v = 15.0 + np.cumsum(a - a.mean()) * h * 0.2
    x = np.r_[0.0, np.cumsum(0.5 * h * (v[1:] + v[:-1]))]
    read = readings(n)
    read["t_s"] = h * np.arange(n)
    read["x_m"] = x + speed_bias_mps * read["t_s"] + rng.normal(0.0, x_std, n)
    read["v_mps"] = v - lag_s * np.gradient(v, h) + rng.normal(0.0, v_std, n)
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(n))
    return bank[0]["noise"]


@pytest.mark.parametrize(("x_std", "v_std"), [(0.01, 0.01), (0.05, 0.02), (1.0, 0.1), (0.01, 0.1)])
def test_the_noise_of_both_sensors_is_found(x_std: float, v_std: float) -> None:
    noise = learnt(np.random.default_rng(0), x_std, v_std)
    assert np.sqrt(noise["r"][0]) == pytest.approx(x_std, rel=0.35)
    assert np.sqrt(noise["r"][1]) == pytest.approx(v_std, rel=0.35)


def test_a_jerky_driver_differs_from_a_smooth_one() -> None:
    rng = np.random.default_rng(1)
    assert (
        learnt(rng, 0.01, 0.01, jerk_std=3.0)["jerk_density"]
        > 5.0 * learnt(rng, 0.01, 0.01, jerk_std=0.3)["jerk_density"]
    )


@pytest.mark.parametrize("speed_bias_mps", [0.0, -0.2, 1.0])
def test_a_speed_bias_is_found(speed_bias_mps: float) -> None:
    """The published simulator's followers have up to 1 m/s, a worn tyre by a tenth of that."""
    noise = learnt(np.random.default_rng(2), 0.01, 0.01, speed_bias_mps=speed_bias_mps)
    assert noise["speed_bias_mps"] == pytest.approx(speed_bias_mps, abs=0.03)


@pytest.mark.parametrize("lag_s", [0.0, 0.1])
def test_a_speed_latency_is_found_as_the_speed_changes(lag_s: float) -> None:
    noise = learnt(np.random.default_rng(3), 0.01, 0.01, jerk_std=4.0, lag_s=lag_s)
    assert noise["speed_latency_s"] == pytest.approx(lag_s, abs=0.02)
