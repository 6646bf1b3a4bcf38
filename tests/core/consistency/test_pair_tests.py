import numpy as np
import pytest
from core.estimation.following import LENGTH_M, START_S, dip, wave

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, PAIR_TESTS, pair_test_params, step_pair_tests
from headway.core.types.records import READING, Kind

CARS = 4
SECONDS = 80.0
FAULT_AT = 700
P = pair_test_params(budget_per_hour=1.0)


def platoon(with_range: bool, faulty: int | None = None) -> np.ndarray:
    """READING (n, 4): linear drivers of different temper behind each other; `faulty` feigns a brake at LIE_AT."""
    rng = np.random.default_rng(11)
    t = np.arange(0.0, SECONDS, 0.1)
    x, v = np.zeros((t.size, CARS)), np.zeros((t.size, CARS))
    v[:, 0] = wave(t)
    x[:, 0] = np.cumsum(0.1 * v[:, 0])
    x[0, 1:] = -25.0 * np.arange(1, CARS)
    v[0] = v[0, 0]
    for k in range(1, t.size):
        late = max(k - 4, 0)
        gap = x[late, :-1] - LENGTH_M - x[late, 1:]
        a = 0.05 * (gap - 1.5 * v[late, 1:]) + np.array([0.5, 0.6, 0.4]) * (v[late, :-1] - v[late, 1:])
        v[k, 1:] = v[k - 1, 1:] + 0.1 * (a + rng.normal(0.0, 0.3, CARS - 1))
        x[k, 1:] = x[k - 1, 1:] + 0.05 * (v[k, 1:] + v[k - 1, 1:])
    readings = np.zeros((t.size, CARS), READING)
    readings["t_s"] = START_S + t[:, None]
    readings["leader_t_s"] = readings["t_s"]
    readings["leader_t_s"][:, 0] = np.nan
    readings["leader_length_m"] = LENGTH_M
    readings["range_m"], readings["range_rate_mps"] = np.nan, np.nan
    if with_range:
        readings["range_m"][:, 1:] = x[:, :-1] - LENGTH_M - x[:, 1:] + rng.normal(0.5, 0.2, (t.size, CARS - 1))
        readings["range_rate_mps"][:, 1:] = v[:, :-1] - v[:, 1:] + rng.normal(0.0, 0.1, (t.size, CARS - 1))
    if faulty is not None:
        speed, location = dip(t.size - FAULT_AT)
        v[FAULT_AT:, faulty] += speed
        x[FAULT_AT:, faulty] += location
    readings["x_m"], readings["v_mps"] = x, v + rng.normal(0.0, 0.02, v.shape)
    readings["leader_x_m"][:, 1:], readings["leader_v_mps"][:, 1:] = x[:, :-1], readings["v_mps"][:, :-1]
    return readings


def run(readings: np.ndarray, leaders: np.ndarray | None = None) -> np.ndarray:
    rows = np.arange(readings.shape[1])
    leaders = rows - 1 if leaders is None else leaders
    pair_tests = np.zeros(rows.size, PAIR_TESTS)
    verdicts = np.zeros(readings.shape, PAIR_TEST_VERDICT)
    for k in range(readings.shape[0]):
        step_pair_tests(pair_tests, rows, leaders, readings[k], P, verdicts[k])
    return verdicts


def last_named(verdicts: np.ndarray) -> int:
    """The suspect of the last alarm."""
    moment, follower = np.argwhere(verdicts["kind"] != Kind.NONE)[-1]
    return int(follower if verdicts["follower_log_odds"][moment, follower] > 0.0 else follower - 1)


@pytest.mark.parametrize("with_range", [False, True])
def test_healthy_vehicles_raise_no_alarm(with_range: bool) -> None:
    verdicts = run(platoon(with_range))
    assert (verdicts["kind"] == Kind.NONE).all()
    assert not verdicts["response"]["warming"][-1, 1:].any()


@pytest.mark.parametrize(
    ("with_range", "faulty"), [(False, 1), (False, 2), *((True, faulty) for faulty in range(CARS))]
)
def test_a_feigned_brake_names_the_faulty_vehicle_wherever_it_drives(with_range: bool, faulty: int) -> None:
    verdicts = run(platoon(with_range, faulty))[: FAULT_AT + 50]
    assert (verdicts["kind"][:FAULT_AT] == Kind.NONE).all()
    assert (verdicts["kind"] == (Kind.RANGE if with_range else Kind.RESPONSE)).any()
    assert last_named(verdicts) == faulty


@pytest.mark.parametrize("faulty", [0, CARS - 1])
def test_a_brake_that_no_neighbour_contradicts_is_no_alarm(faulty: int) -> None:
    """The last car brakes although its leader does not, or the first one although nobody follows it in that."""
    verdicts = run(platoon(with_range=False, faulty=faulty))[: FAULT_AT + 50]
    response = verdicts["response"][FAULT_AT:, max(faulty, 1)]
    assert (response["statistic"] > response["gate"]).any()
    assert (verdicts["kind"] == Kind.NONE).all()


def test_the_suspect_stands_when_the_alarm_is_over() -> None:
    """What ends an event blames whom it has blamed."""
    verdicts = run(platoon(with_range=False, faulty=1))
    for follower in (1, 2):
        last = int(np.flatnonzero(verdicts["kind"][:, follower] != Kind.NONE)[-1])
        odds = verdicts["follower_log_odds"][:, follower]
        assert odds[last] != 0.0
        assert (odds[last:] == odds[last]).all()


def test_the_verdict_does_not_depend_on_the_order_of_a_round() -> None:
    readings = platoon(with_range=True, faulty=1)
    forward = run(readings)
    backwards = np.arange(CARS)[::-1].copy()
    pair_tests = np.zeros(CARS, PAIR_TESTS)
    for k in range(readings.shape[0]):
        verdicts = np.zeros(CARS, PAIR_TEST_VERDICT)
        step_pair_tests(pair_tests, backwards, backwards - 1, readings[k][backwards].copy(), P, verdicts)
        assert (verdicts["kind"][::-1] == forward["kind"][k]).all()


def test_another_leader_starts_with_new_offsets() -> None:
    readings = platoon(with_range=True)
    rows, pair_tests = np.arange(CARS), np.zeros(CARS, PAIR_TESTS)
    verdicts = np.zeros(CARS, PAIR_TEST_VERDICT)
    for k in range(600):
        step_pair_tests(pair_tests, rows, rows - 1, readings[k], P, verdicts)
    assert not verdicts["ranging"]["warming"][2]
    overtaken = np.array([-1, 0, 0, 2])
    step_pair_tests(pair_tests, rows, overtaken, readings[600], P, verdicts)
    assert verdicts["ranging"]["warming"][2]
    assert verdicts["response"]["warming"][2]
    assert not verdicts["ranging"]["warming"][3]
    assert pair_tests["response"]["learning_time_s"][2] > P.response.warming_s


def test_a_short_gap_of_the_leader_keeps_the_pair() -> None:
    readings = platoon(with_range=True)
    for name in ("leader_t_s", "leader_x_m", "leader_v_mps"):
        readings[name][600:605, 2] = np.nan
    rows, pair_tests = np.arange(CARS), np.zeros(CARS, PAIR_TESTS)
    verdicts = np.zeros(CARS, PAIR_TEST_VERDICT)
    for k in range(620):
        leaders = np.array([-1, 0, -1 if 600 <= k < 605 else 1, 2])
        step_pair_tests(pair_tests, rows, leaders, readings[k], P, verdicts)
        assert (verdicts["kind"] == Kind.NONE).all()
    assert not verdicts["ranging"]["warming"][2]
    assert not verdicts["response"]["warming"][2]
