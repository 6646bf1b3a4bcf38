"""The leader as an input: the response gain of a driver is found, and deviations from it are detected."""

import numpy as np
import pytest
from core.driving import run_model

from headway.core.estimation.car_following import IdmParams, idm
from headway.core.estimation.imm.driver_input import (
    DriverParams,
    adapt_response_gain,
    driver_dtype,
    initialise_driver,
    predict_acceleration,
    unexplained_share,
)
from headway.core.runtime.rows import readings

DELAY_S = 0.5
LENGTH_M = 5.0
JERK_MPS3 = 5.0
P = DriverParams(
    IdmParams(),
    DELAY_S,
    accel_change_max_mps2=1.0,
    prior_information=60.0,
    forgetting_factor=0.9995,
    explained_step=0.002,
)


def follow(rng, gain, n=3000, *, own_std_mps2=0.0, x_walk_m=0.0, cut_in=None):
    """Readings of a car whose acceleration is `gain` times the model's, tau after its leader, and a will of its own."""
    h = 0.1
    t_s = h * np.arange(n)
    leader_v = 14.0 + 4.0 * np.sin(0.11 * t_s) + 2.0 * np.sin(0.31 * t_s + 1.0)
    leader_x = 60.0 + np.r_[0.0, np.cumsum(0.5 * h * (leader_v[1:] + leader_v[:-1]))]
    if cut_in is not None:
        leader_x[cut_in:] -= 6.0
    late, own, a = round(DELAY_S / h), 0.0, 0.0
    x, v = np.zeros(n), np.full(n, 14.0)
    for k in range(n - 1):
        seen = max(0, k - late)
        own += -0.02 * own + own_std_mps2 * 0.2 * rng.normal()
        wanted, _, _, _ = idm(leader_x[seen] - LENGTH_M - x[k], v[k], leader_v[seen], P.idm)
        a += np.clip(gain * wanted + own - a, -JERK_MPS3 * h, JERK_MPS3 * h)
        v[k + 1] = max(0.0, v[k] + h * a)
        x[k + 1] = x[k] + 0.5 * h * (v[k] + v[k + 1])
    read = readings(n)
    read["t_s"] = read["leader_t_s"] = t_s
    read["leader_x_m"], read["leader_v_mps"], read["leader_length_m"] = leader_x, leader_v, LENGTH_M
    read["x_m"] = x + np.cumsum(rng.normal(0.0, x_walk_m, n)) + rng.normal(0.0, 0.01, n)
    read["v_mps"] = v + rng.normal(0.0, 0.01, n)
    return read


@pytest.mark.parametrize("gain", [0.4, 1.0, 1.5])
def test_the_response_gain_is_found(gain: float) -> None:
    _, row = run_model(follow(np.random.default_rng(0), gain), delay_s=DELAY_S)
    assert row[0]["driver"]["response_gain"] == pytest.approx(gain, abs=0.1)


def test_an_independent_driver_has_a_small_response_gain() -> None:
    _, row = run_model(follow(np.random.default_rng(1), 0.02, own_std_mps2=0.8), delay_s=DELAY_S)
    assert row[0]["driver"]["response_gain"] < 0.2
    assert unexplained_share(row[0]["driver"], row[0]["noise"]["jerk_density"]) > 0.9


def test_a_change_that_the_leader_explains_is_no_manoeuvre() -> None:
    _, row = run_model(follow(np.random.default_rng(2), 1.0), delay_s=DELAY_S)
    driver = row[0]["driver"]
    assert unexplained_share(driver, row[0]["noise"]["jerk_density"]) < 0.2
    driver["idm_accel_mps2"] = np.nan
    assert unexplained_share(driver, row[0]["noise"]["jerk_density"]) == 1.0, "no leader, nothing explained"


def test_the_leader_exposes_a_drift_of_the_speed_beside_a_random_walk() -> None:
    """The location walks by 2 cm a reading, so that a speed that gains 0.5 m/s in two seconds is nothing to it."""
    found = {True: 0, False: 0}
    for seed in range(6):
        read = follow(np.random.default_rng(10 + seed), 1.0, x_walk_m=0.02)
        read["v_mps"][2000:2020] += np.linspace(0.0, 0.5, 20)
        for led in found:
            readings = read.copy()
            if not led:
                readings["leader_t_s"] = np.nan
            results, _ = run_model(readings, delay_s=DELAY_S)
            found[led] += results["anomalous"][2000:2020].any()
    assert found[True] >= 5
    assert found[False] <= 3


def test_another_car_ahead_is_no_alarm() -> None:
    """It cuts in 6 m nearer, and the driver brakes; later ten seconds of its messages are missing."""
    for seed in range(4):
        read = follow(np.random.default_rng(20 + seed), 1.0, cut_in=2000)
        read["leader_t_s"][2500:2600] = np.nan
        results, _ = run_model(read, delay_s=DELAY_S)
        assert not results["anomalous"][200:].any()


def test_the_predicted_change_follows_the_leader_after_the_delay() -> None:
    driver, z = np.zeros(1, driver_dtype(DELAY_S))[0], readings(1)[0]
    initialise_driver(driver, P)
    driver["response_gain"] = 0.5
    wanted = []
    for k in range(20):
        z["t_s"] = z["leader_t_s"] = 0.1 * k
        z["leader_x_m"], z["leader_v_mps"], z["leader_length_m"] = 40.0 + k, 10.0 if k < 10 else 8.0, LENGTH_M
        change = predict_acceleration(driver, z, 0.1, float(k), 10.0, P)
        wanted.append(idm(30.0, 10.0, 10.0 if k < 15 else 8.0, P.idm)[0])
        assert change == pytest.approx(0.0 if k == 0 else 0.5 * (wanted[-1] - wanted[-2]), abs=1e-6)


def test_the_response_gain_is_that_of_least_squares() -> None:
    """With no gain of the filter the sensitivity adds up, and the gain is the slope of the innovation on it, shrunk."""
    rng = np.random.default_rng(4)
    driver = np.zeros(1, driver_dtype(DELAY_S))[0]
    everlasting = P._replace(forgetting_factor=1.0)
    initialise_driver(driver, everlasting)
    sensitivity, nu, known = [], [], 0.0
    for _ in range(200):
        driver["accel_sensitivity"] += rng.normal(0.0, 0.1)
        sensitivity.append(float(driver["speed_sensitivity"] + 0.1 * driver["accel_sensitivity"]))
        nu.append((0.7 - known) * sensitivity[-1] + rng.normal(0.0, 0.05))
        adapt_response_gain(driver, 0.1, nu[-1], 0.05**2, 0.0, 0.0, everlasting)
        nu[-1] += known * sensitivity[-1]
        known = float(driver["response_gain"])
    f, y = np.array(sensitivity), np.array(nu)
    assert known == pytest.approx(f @ y / (f @ f + P.prior_information * 0.05**2), rel=0.02)


def test_the_unexplained_share_has_a_minimum() -> None:
    """An hour behind a car that stands: no jerk and no explained density."""
    driver = np.zeros(1, driver_dtype(DELAY_S))[0]
    assert unexplained_share(driver, 1e-12) == 1.0
    driver["explained_density"] = 1.0
    assert unexplained_share(driver, 1e-12) == 1e-3
