"""Bias, scale and latency of a speed are found from positions, within what receivers are."""

import numpy as np
import pytest
from numba import njit

from headway.core.estimation.imm.speed_calibration import (
    CALIBRATION,
    CalibrationParams,
    add_speed_excess,
    calibration_variance,
    initialise_calibration,
    observe_dead_zone,
    observe_speed_step,
    predict_calibration,
    update_calibration,
)
from headway.core.estimation.imm.step import headway_dtype, headway_params, step_row
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

CONFIG = DetectorConfig()
P = headway_params(CONFIG)


@njit
def drive(row, read, p, results):
    for k in range(read.size):
        step_row(row, read[k], p, results[k])


def calibrated(seed, bias_mps=0.0, scale=0.0, latency_s=0.0, v_amplitude_mps=8.0, n=3000):
    """Return the calibration after five minutes of a car whose speed comes and goes."""
    rng, h = np.random.default_rng(seed), 0.1
    v = 15.0 + v_amplitude_mps * np.sin(0.02 * np.arange(n))
    x = np.r_[0.0, np.cumsum(0.5 * h * (v[1:] + v[:-1]))]
    read = readings(n)
    read["t_s"] = h * np.arange(n)
    read["x_m"] = x + rng.normal(0.0, 0.01, n)
    read["v_mps"] = (v - latency_s * np.gradient(v, h) - bias_mps) / (1.0 + scale) + rng.normal(0.0, 0.01, n)
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(n))
    return bank[0]["calibration"]


@pytest.mark.parametrize("scale", [-0.02, 0.0, 0.03])
def test_a_speed_that_is_off_by_a_share_of_itself_is_found(scale: float) -> None:
    found = calibrated(1, scale=scale)
    assert found["scale"] == pytest.approx(scale, abs=0.003)
    assert found["latency_s"] == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("bias_mps", [-0.2, 0.0, 1.0])
def test_a_bias_is_found_where_it_cannot_be_told_from_a_scale(bias_mps: float) -> None:
    """The published simulator's followers have up to 1 m/s, a worn tyre a tenth of that."""
    found = calibrated(2, bias_mps=bias_mps, v_amplitude_mps=0.2)
    assert found["bias_mps"] + 15.0 * found["scale"] == pytest.approx(bias_mps, abs=0.03)


@pytest.mark.parametrize("latency_s", [-0.2, 0.0, 0.1])
def test_how_old_the_speed_is_beside_the_position_is_found(latency_s: float) -> None:
    assert calibrated(3, latency_s=latency_s)["latency_s"] == pytest.approx(latency_s, abs=0.02)


def test_the_bias_at_rest_is_another_than_that_in_motion() -> None:
    """Positions wander at rest, and a wheel that is worn does not turn: neither says anything of the other."""
    row, p = np.zeros(1, CALIBRATION)[0], CalibrationParams()
    initialise_calibration(row, p)
    for v, bias_mps in [(15.0, 0.1)] * 300 + [(0.0, -0.02)] * 300 + [(15.0, 0.1)]:
        predict_calibration(row, 0.1, v, 0.0)
        expected = 0.1 * (bias_mps - row["bias_mps"] - v * row["scale"])
        update_calibration(row, expected, 1e-4, 1e-4, p)
        row["sensitivity"] *= 0.1
    assert row["bias_mps"] + 15.0 * row["scale"] == pytest.approx(0.1, abs=0.01)
    predict_calibration(row, 0.1, 0.0, 0.0)
    assert row["bias_mps"] == pytest.approx(-0.02, abs=0.01)


@pytest.mark.parametrize(("least_mps", "dead_zone_mps"), [(0.05, 0.15), (0.3, 0.3), (0.5, 0.4)])
def test_the_dead_zone_of_a_sensor_is_what_it_never_reports(least_mps: float, dead_zone_mps: float) -> None:
    row, p = np.zeros(1, CALIBRATION)[0], CalibrationParams()
    initialise_calibration(row, p)
    for v in np.linspace(least_mps, 2.0, 200):
        observe_dead_zone(row, v, p)
    assert row["dead_zone_mps"] == pytest.approx(dead_zone_mps, abs=0.02)


@pytest.mark.parametrize("scale", [0.2, -0.3])
def test_nothing_is_learnt_beyond_what_receivers_are(scale: float) -> None:
    assert abs(calibrated(4, scale=scale)["scale"]) <= CalibrationParams().scale_max


def test_it_is_a_kalman_filter_of_the_three() -> None:
    """Against the textbook's update in matrices, with a filter that keeps a tenth of its error at a reading."""
    p = CalibrationParams()._replace(bias_walk_mps=0.0, latency_walk_s=0.0, scale_walk=0.0)
    rng, row = np.random.default_rng(5), np.zeros(1, CALIBRATION)[0]
    initialise_calibration(row, p)
    mean, cov, c = np.zeros(3), np.diag([p.bias_std_mps, p.latency_std_s, p.scale_std]) ** 2, np.zeros(3)
    for _ in range(20):
        v, a, nu, s = rng.uniform(5.0, 25.0), rng.normal(0.0, 1.0), rng.normal(0.0, 0.01), 1e-3
        row["mean_speed_mps"] = v
        ahead_m = predict_calibration(row, 0.1, v, a)
        moved = np.array([0.1, row["mean_speed_mps"] - v, 0.1 * v])
        assert ahead_m == pytest.approx(moved @ mean)
        c += moved
        assert calibration_variance(row) == pytest.approx(c @ cov @ c, rel=1e-9)
        gain = cov @ c / (c @ cov @ c + s)
        bound = 3.0 * np.sqrt(c @ cov @ c + s)
        change = gain * np.clip(nu, -bound, bound)
        assert update_calibration(row, nu, s, 1e-15, p) == pytest.approx(c @ change, rel=1e-9)
        mean, cov = mean + change, cov - np.outer(gain, c @ cov)
        np.testing.assert_allclose([row["bias_mps"], row["latency_s"], row["scale"]], mean, rtol=1e-8)
        row["sensitivity"] *= 0.1
        c *= 0.1


@pytest.mark.parametrize("step_mps", [0.02, 0.1, 0.11176, 1.0 / 3.6])
def test_the_step_of_reported_speeds_is_found(step_mps: float) -> None:
    row, p = np.zeros(1, CALIBRATION)[0], CalibrationParams()
    initialise_calibration(row, p)
    for v in 15.0 + 5.0 * np.sin(0.05 * np.arange(300)):
        observe_speed_step(row, step_mps * np.round(v / step_mps), p)
    assert row["speed_step_mps"] == pytest.approx(step_mps, rel=0.35)


def test_correlated_noise_of_the_speed_shows_no_latency() -> None:
    """For a third of a second it looks like a change of speed that the positions do not have yet."""
    rng, h, n = np.random.default_rng(4), 0.1, 600
    v = np.full(n, 15.0)
    read = readings(n)
    read["t_s"] = h * np.arange(n)
    read["x_m"] = h * np.cumsum(v) + rng.normal(0.0, 0.01, n)
    read["v_mps"] = v + 0.05 * np.convolve(rng.normal(0.0, 1.0, n), [1.0, 0.4, 0.15, 0.05])[:n]
    bank = np.zeros(1, headway_dtype(CONFIG.delay_s))
    drive(bank[0], read, P, verdicts(n))
    assert bank[0]["calibration"]["latency_s"] == pytest.approx(0.0, abs=0.03)
    assert np.sqrt(bank[0]["calibration"]["P"][2]) > 0.5 * CalibrationParams().latency_std_s


@pytest.mark.parametrize("age_s", [0.0, 0.1, 0.5])
def test_a_position_lags_by_the_mean_speed_of_its_age(age_s: float) -> None:
    row, h, rate = np.zeros(1, CALIBRATION)[0], 0.1, 2.0
    initialise_calibration(row, CalibrationParams())
    row["latency_s"], row["mean_speed_mps"] = -age_s, 10.0
    ahead_m = sum(predict_calibration(row, h, 10.0 + rate * h * k, rate) for k in range(60))
    assert row["mean_speed_mps"] == pytest.approx(10.0 + 6.0 * rate - 0.5 * age_s * rate, abs=1e-6)
    assert ahead_m == pytest.approx(-age_s * (6.0 * rate - 0.5 * age_s * rate), abs=1e-6)


@pytest.mark.parametrize("latency_s", [-0.5, -0.2, -0.1])
def test_old_positions_are_known_after_the_first_brake(latency_s: float) -> None:
    """A car that drove at a constant speed for half a minute brakes: no fault of either sensor."""
    rng, h, n = np.random.default_rng(6), 0.1, 350
    t = h * np.arange(n)
    v = 15.0 - 4.5 * (1.0 - np.cos(np.pi * np.clip((t - 30.0) / 5.0, 0.0, 1.0)))
    x = h * (np.cumsum(v) - 0.5 * v)
    read = readings(n)
    read["t_s"] = t
    read["x_m"] = np.interp(t + latency_s, t, x) + rng.normal(0.0, 0.01, n)
    read["v_mps"] = v + rng.normal(0.0, 0.01, n)
    bank, out = np.zeros(1, headway_dtype(CONFIG.delay_s)), verdicts(n)
    drive(bank[0], read, P, out)
    assert not out["anomalous"].any()
    assert bank[0]["calibration"]["latency_s"] == pytest.approx(latency_s, abs=0.05)


@pytest.mark.parametrize(("a_mps2", "latency_share"), [(0.0, 0.0), (-3.0, 0.9)])
def test_what_a_drift_showed_is_a_latency_where_the_vehicle_brakes(a_mps2: float, latency_share: float) -> None:
    row, p = np.zeros(1, CALIBRATION)[0], CalibrationParams()
    initialise_calibration(row, p)
    add_speed_excess(row, 0.5, 10.0, a_mps2, p)
    assert row["bias_mps"] + row["latency_s"] * a_mps2 + 10.0 * row["scale"] == pytest.approx(0.5)
    assert row["latency_s"] * a_mps2 == pytest.approx(0.5 * latency_share, abs=0.05)


def test_a_receiver_of_one_hertz_that_stops_has_no_fault() -> None:
    """Its last position before the stop is repeated, while the vehicle rolls on for the rest of the second."""
    rng, h = np.random.default_rng(7), 0.1
    for start_s in 20.0 + h * np.arange(10):
        t = h * np.arange(400)
        v = 7.5 * (1.0 + np.cos(np.pi * np.clip((t - start_s) / 8.0, 0.0, 1.0)))
        x = (h * (np.cumsum(v) - 0.5 * v) + rng.normal(0.0, 0.01, t.size))[np.arange(t.size) // 10 * 10]
        read = readings(t.size)
        read["t_s"], read["x_m"], read["east_m"] = t, x, np.diff(x, prepend=0.0)
        read["v_mps"] = np.maximum(v + rng.normal(0.0, 0.01, t.size), 0.0)
        bank, out = np.zeros(1, headway_dtype(CONFIG.delay_s)), verdicts(t.size)
        drive(bank[0], read, P, out)
        assert not out["anomalous"].any()
