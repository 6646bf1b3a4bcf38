import numpy as np
import pytest
from core.estimation.following import START_S, dip, follow, wave

from headway.core.consistency.response import (
    COLUMNS,
    LAGS,
    MEAN_DRIVER,
    PULSE,
    RESPONSE,
    STATE_COLUMNS,
    WINDOW_TICKS,
    ResponseParams,
    answer_spread_ms,
    response_reset_leader,
    response_step,
)
from headway.core.statistics.test_result import CHECK, check_budget

P = ResponseParams(check_budget(1.0))
WITHOUT_DECAY = P._replace(memory_s=1e12)


def run(readings: np.ndarray, p: ResponseParams = P, row: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    """The row after all readings, and a CHECK for each."""
    row = np.zeros(1, RESPONSE) if row is None else row
    checks = np.zeros(readings.size, CHECK)
    for reading, check in zip(readings, checks, strict=True):
        response_step(row[0], reading, p, check)
    return row, checks


def batch(readings: np.ndarray, ridge: float) -> np.ndarray:
    """theta by least squares on the whole drive, from the equation in the module's docstring."""
    at = readings[::4]
    gap = at["leader_x_m"] - at["leader_length_m"] - at["x_m"]
    state = np.stack(
        [np.ones(at.size), gap / 20.0, at["v_mps"] / 10.0, at["leader_v_mps"] - at["v_mps"], np.log(gap)], axis=1
    )
    a, a_leader = np.diff(at["v_mps"]) / 0.4, np.diff(at["leader_v_mps"]) / 0.4
    rows = [np.concatenate([state[k], a_leader[k - LAGS + 1 : k + 1][::-1]]) for k in range(LAGS - 1, len(a))]
    phi, y = np.array(rows) * np.sqrt(0.4), a[LAGS - 1 :] * np.sqrt(0.4)
    phi = np.vstack([phi, np.sqrt(ridge) * np.eye(COLUMNS)])
    y = np.concatenate([y, np.sqrt(ridge) * np.array(MEAN_DRIVER)])
    return np.linalg.lstsq(phi, y, rcond=None)[0]


def test_theta_is_the_least_squares_fit_of_the_whole_drive() -> None:
    readings = follow(100.0, np.random.default_rng(0), noise=0.01)
    last_solved = readings[: 4 * 240 + 1]  # ticks 5, 10, ... are solved
    row, checks = run(last_solved, WITHOUT_DECAY)
    assert checks["statistic"].max() < 3.0  # no tick was given less weight
    assert row["theta"][0] == pytest.approx(batch(last_solved, P.ridge_s), rel=1e-6, abs=1e-6)


def test_pulse_gives_back_a_speed_change_of_its_own_shape() -> None:
    shape = np.sin(np.pi * (np.arange(5) + 0.5) / 5)
    assert np.dot(PULSE, shape / shape.sum()) == pytest.approx(1.0, abs=1e-3)


def test_a_feigned_brake_is_found_and_the_follower_moved() -> None:
    readings = follow(120.0, np.random.default_rng(1))
    speed, location = dip(100)
    readings["v_mps"][1000:1100] += speed
    readings["x_m"][1000:1100] += location
    _, checks = run(readings)
    assert not checks["anomalous"][:1000].any()
    found = np.flatnonzero(checks["anomalous"])
    assert 1000 < found[0] < 1030
    assert checks["p_value"][found[0]] < 1e-4
    at_onset, _ = run(readings[: found[0] + 1])
    assert at_onset["follower_surprise"][0] > at_onset["leader_surprise"][0] + 1.0


def test_a_feigned_manoeuvre_of_the_leader_has_no_response() -> None:
    readings = follow(120.0, np.random.default_rng(2))
    speed, location = dip(60)
    readings["leader_v_mps"][1000:1060] += speed
    readings["leader_x_m"][1000:1060] += location
    _, checks = run(readings)
    found = np.flatnonzero(checks["anomalous"])
    assert 1000 < found[0] < 1060
    at_last, _ = run(readings[: found[-1] + 1])
    assert at_last["leader_surprise"][0] > at_last["follower_surprise"][0] + 0.25


def test_braking_in_response_to_the_leader_is_no_anomaly() -> None:
    def brakes(t_s: np.ndarray) -> np.ndarray:
        return wave(t_s) - 3.0 * np.exp(-(((t_s - 102.0) / 1.5) ** 2))

    readings = follow(120.0, np.random.default_rng(3), leader=brakes)
    _, checks = run(readings)
    assert not checks["anomalous"].any()
    row, _ = run(readings[:1040])
    assert row["pair_fault"]["log_odds"][0] < -1.0


def test_a_leader_without_a_response_raises_the_fault_log_odds() -> None:
    readings = follow(120.0, np.random.default_rng(2))
    calm, _ = run(readings[:1040])
    speed, location = dip(40)
    readings["leader_v_mps"][1000:1040] += speed
    readings["leader_x_m"][1000:1040] += location
    row, _ = run(readings[:1040])
    assert row["pair_fault"]["log_odds"][0] > max(calm["pair_fault"]["log_odds"][0], 0.0) + 2.0


def test_a_speed_that_is_frozen_while_the_leader_changes_drifts() -> None:
    readings = follow(120.0, np.random.default_rng(1))
    frozen = readings.copy()
    frozen["v_mps"][1100:] = readings["v_mps"][1100]
    frozen["x_m"][1100:] = readings["x_m"][1100] + 0.1 * readings["v_mps"][1100] * np.arange(100)
    (healthy, _), (row, checks) = run(readings), run(frozen)
    assert checks["anomalous"][1100:].any()
    unexplained_mps = (row["measured_drift_mps"] - row["predicted_drift_mps"])[0]
    assert abs(unexplained_mps) > 10.0 * abs(healthy["measured_drift_mps"] - healthy["predicted_drift_mps"])[0]
    assert row["still_share"][0, 0] < 0.1
    assert row["follower_surprise"][0] > 1.5  # a speed that never stands still does


def test_a_constant_speed_is_no_surprise_in_a_driver_that_often_keeps_one() -> None:
    readings = follow(120.0, np.random.default_rng(9), leader=lambda t_s: np.full(t_s.size, 12.0), noise=0.001)
    row, _ = run(readings)
    assert (row["still_share"][0] > 0.5).all()
    assert (
        row["follower_surprise"][0]
        == pytest.approx(row["leader_surprise"][0], abs=0.01)
        == pytest.approx(0.0, abs=0.01)
    )


def test_the_variance_grows_with_the_manoeuvre_that_was_answered() -> None:
    """Half as much again as was due is one standard deviation; no answer, or one to the other side, is not excused."""
    assert answer_spread_ms(3.0, 2.0) == answer_spread_ms(-2.0, -3.0) == pytest.approx(1.0)
    assert answer_spread_ms(0.0, 2.0) == answer_spread_ms(-2.0, 2.0) == 0.0


def test_a_driver_with_rare_exceedances_is_learnt_in_the_end() -> None:
    """A statistic that swings about the gate must not keep the row from learning."""
    readings = follow(400.0, np.random.default_rng(8))
    t_s = readings["t_s"] - START_S
    readings["v_mps"] += 3.0 * np.sin(0.4 * np.pi * t_s) * (t_s > 100.0)
    _, checks = run(readings)
    assert 0.1 < checks["anomalous"][1000:1600].mean() < 0.9
    assert not checks["anomalous"][2500:].any()


def test_the_anomaly_is_not_learnt() -> None:
    readings = follow(110.0, np.random.default_rng(4))
    healthy = readings.copy()
    speed, location = dip(100, depth_mps=6.0)
    readings["v_mps"][1000:] += speed
    readings["x_m"][1000:] += location
    with_fault, checks = run(readings[:1045])
    without_fault, _ = run(healthy[:1045])
    assert checks["anomalous"].sum() > 20
    assert with_fault["theta"][0] == pytest.approx(without_fault["theta"][0], abs=0.02)
    assert with_fault["residual_ms"][0] == pytest.approx(without_fault["residual_ms"][0], rel=0.2)


def test_warming_until_enough_was_learnt_and_after_a_new_leader() -> None:
    readings = follow(80.0, np.random.default_rng(5))
    row, checks = run(readings)
    until = int(np.argmax(~checks["warming"]))
    assert P.warming_s < readings["t_s"][until] - START_S < P.warming_s + 5.0
    assert not checks["warming"][until:].any()
    response_reset_leader(row[0])
    again = readings.copy()
    again["t_s"] += 80.0
    again["leader_t_s"] += 80.0
    _, checks = run(again, row=row)
    until = int(np.argmax(~checks["warming"]))
    assert until == pytest.approx(4 * WINDOW_TICKS, abs=4)


def test_without_a_leader_the_check_is_warming() -> None:
    readings = follow(60.0, np.random.default_rng(6))
    for name in ("leader_t_s", "leader_x_m", "leader_v_mps", "leader_length_m"):
        readings[name] = np.nan
    row, checks = run(readings)
    assert checks["warming"].all()
    assert not checks["anomalous"].any()
    assert row["learning_time_s"][0] == 0.0


def test_a_driver_that_changes_for_good_is_learnt_again() -> None:
    """A change of manner far beyond the gate alarms, then is how this driver drives."""
    rng = np.random.default_rng(7)
    readings = follow(600.0, rng)
    nervous = 4.0 * np.sin(0.25 * np.pi * (readings["t_s"] - START_S)) * (readings["t_s"] > START_S + 100.0)
    readings["v_mps"] += nervous
    _, checks = run(readings)
    assert checks["anomalous"][1000:2000].any()
    assert not checks["anomalous"][4500:].any()


def test_the_row_is_small_and_its_fields_have_names() -> None:
    assert RESPONSE.itemsize <= 2048
    assert RESPONSE["theta"].shape == (STATE_COLUMNS + LAGS,)
