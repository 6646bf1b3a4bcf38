"""Adapted noise converges from any start, on readings of known noise."""

import numpy as np
import pytest
from numba import njit

from headway.core.estimation.imm.noise_adaptation import position_variance
from headway.core.estimation.imm.step import headway_dtype, headway_params, step_row
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

CONFIG = DetectorConfig()
P = headway_params(CONFIG)


@njit
def drive(row, read, p, results):
    for k in range(read.size):
        step_row(row, read[k], p, results[k])


def adapted(rng, x_std, v_std, jerk_std=0.8, n=3000):
    """Return the row after five minutes of a car whose acceleration wanders."""
    h = 0.1
    a = np.zeros(n)
    for k in range(1, n):
        a[k] = 0.995 * a[k - 1] + np.sqrt(h) * jerk_std * rng.normal() * 0.5
    v = 15.0 + np.cumsum(a - a.mean()) * h * 0.2
    x = np.r_[0.0, np.cumsum(0.5 * h * (v[1:] + v[:-1]))]
    read = readings(n)
    read["t_s"] = h * np.arange(n)
    read["x_m"] = x + rng.normal(0.0, x_std, n)
    read["v_mps"] = v + rng.normal(0.0, v_std, n)
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(n))
    return bank[0]


@pytest.mark.parametrize(("x_std", "v_std"), [(0.01, 0.01), (0.05, 0.02), (1.0, 0.1), (0.01, 0.1)])
def test_the_noise_of_both_sensors_is_found(x_std: float, v_std: float) -> None:
    """That of the position is known at the speed that the car drove, and not at rest."""
    noise = adapted(np.random.default_rng(0), x_std, v_std)["noise"]
    assert np.sqrt(position_variance(noise, 15.0)) == pytest.approx(x_std, rel=0.35)
    assert np.sqrt(noise["r"][1]) == pytest.approx(v_std, rel=0.35)


def test_a_jerky_driver_differs_from_a_smooth_one() -> None:
    rng = np.random.default_rng(1)
    assert (
        adapted(rng, 0.01, 0.01, jerk_std=3.0)["noise"]["jerk_density"]
        > 5.0 * adapted(rng, 0.01, 0.01, jerk_std=0.3)["noise"]["jerk_density"]
    )


def test_positions_whose_time_stamps_are_noisy_are_noisier_in_motion_than_at_rest() -> None:
    """An error of 20 ms is 0.4 m at 20 m/s and nothing at rest; after a stop, the noise in motion is still known."""
    rng, h = np.random.default_rng(5), 0.1
    v = np.repeat([20.0, 0.0, 20.0, 0.0], 300)
    v = np.convolve(np.r_[np.full(50, 20.0), v], np.full(50, 0.02))[50:-49]
    x = np.cumsum(h * v)
    read = readings(v.size)
    read["t_s"] = h * np.arange(v.size)
    read["x_m"] = x + v * rng.normal(0.0, 0.02, v.size) + rng.normal(0.0, 0.01, v.size)
    read["v_mps"] = np.maximum(v + rng.normal(0.0, 0.01, v.size), 0.0)
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(v.size))
    noise = bank[0]["noise"]
    assert np.sqrt(position_variance(noise, 0.0)) < 0.15
    assert np.sqrt(position_variance(noise, 20.0)) == pytest.approx(0.4, rel=0.5)


def test_a_standing_vehicle_keeps_what_was_known_of_its_speed() -> None:
    """Positions and speeds that do not change at all say nothing of the noise in motion."""
    read = readings(600)
    read["t_s"], read["x_m"], read["v_mps"] = 0.1 * np.arange(600), 0.0, 0.0
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(600))
    assert np.sqrt(bank[0]["noise"]["r"]) == pytest.approx([0.01, 0.02], rel=0.01)
    assert bank[0]["noise"]["jerk_density"] >= 0.1
    assert bank[0]["noise"]["adapted_readings"] == 0.0


@pytest.mark.parametrize("jitter_s", [0.01, 0.03])
def test_noise_that_a_mode_of_noise_explains_is_still_learnt(jitter_s: float) -> None:
    """From the first message on: each large innovation is doubtful, and only small ones would be left."""
    h, n, v = 0.1, 400, 17.0
    for seed in range(20):
        rng = np.random.default_rng(seed)
        read = readings(n)
        read["t_s"] = h * np.arange(n)
        read["x_m"] = v * (read["t_s"] + rng.normal(0.0, jitter_s, n)) + rng.normal(0.0, 0.01, n)
        read["v_mps"] = v + rng.normal(0.0, 0.01, n)
        bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
        drive(bank[0], read, P, verdicts(n))
        assert np.sqrt(position_variance(bank[0]["noise"], v)) == pytest.approx(v * jitter_s, rel=0.5)
