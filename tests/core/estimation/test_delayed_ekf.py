"""The paper's filters against oracles that share no code with them: a twin, filterpy, solved equations, statistics."""

import numpy as np
import pytest
from core.estimation.twin import Twin
from filterpy.kalman import KalmanFilter
from numpy.polynomial import Polynomial
from scipy.linalg import expm
from scipy.stats import chi2

from headway.core.estimation.car_following import IdmParams
from headway.core.estimation.delay_buffers import push_own
from headway.core.estimation.delayed_ekf import (
    P_FLOOR,
    WORKSPACE,
    initialise,
    predict,
    repair_covariance,
    step_batch,
    step_row,
)
from headway.core.estimation.registry import paper_dtype, paper_params
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

ORDERS = {"ekf": 2, "aekf": 3}
DELAY_MAX_S = 5.0
SPACE = np.zeros(1, WORKSPACE)[0]
FREE_LINEAR = IdmParams(a_mps2=1.0, delta=1.0, v0_mps=2.0)
"""On a free road with delta = 1, f_v = a - (a / v0) v."""


def params(model="ekf", **changes):
    config = DetectorConfig(
        model=model, delay_s=changes.pop("delay_s", 0.0), delay_jitter_s=changes.pop("delay_jitter_s", 0.0)
    )
    return paper_params(config)._replace(**{"warming_readings": 0, "gate": np.inf, **changes})


def fresh(model="ekf"):
    return np.zeros(1, paper_dtype(ORDERS[model], DELAY_MAX_S))


def reading(t_s, x_m, v_mps, leader=None):
    made = readings(1)
    made[["t_s", "x_m", "v_mps"]] = (t_s, x_m, v_mps)
    if leader is not None:
        made[["leader_t_s", "leader_x_m", "leader_v_mps", "leader_length_m"]] = (*leader, 5.0)
    return made


def step(bank, z, p):
    verdict = verdicts(1)
    step_row(bank[0], z[0], p, verdict[0])
    return verdict[0]


def drive(rng, duration_s):
    """Yield (t, z, leader) of a follower behind a leader who slows and speeds up, at uneven times, with two faults."""
    t = 0.0
    faults = set(rng.uniform(0.3 * duration_s, duration_s, 2).round(0))
    while t < duration_s:
        leader_t = t - 0.03
        leader = (leader_t, 60.0 + 14.0 * leader_t - 20.0 * np.cos(0.2 * leader_t), 14.0 + 4.0 * np.sin(0.2 * leader_t))
        z = np.array([14.0 * t - 20.0 * np.cos(0.2 * (t - 1.0)), 14.0 + 4.0 * np.sin(0.2 * (t - 1.0))])
        z += rng.normal(0.0, 0.05, 2)
        if round(t, 0) in faults:
            faults.discard(round(t, 0))
            z[rng.integers(2)] += 30.0
        yield t, z, leader
        t += rng.choice([0.1, rng.normal(0.1, 0.005), rng.uniform(0.1, 0.6), 2.0], p=[0.4, 0.4, 0.18, 0.02])


@pytest.mark.parametrize(
    ("delay_s", "duration_s", "within"),
    [(0.0, 30, 1e-4), (0.03, 30, 3e-2), (0.5, 30, 3e-2), (1.5, 30, 0.1), (5.0, 12, 0.1)],
)
@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_kernel_is_the_twin_of_the_equations(model: str, delay_s: float, duration_s: float, within: float) -> None:
    """Simpson's rule over a reading's interval cuts the corners of the past: hence mm with a delay, and um without.

    At tau = 5 s Model 2 diverges on its own after a few tau, in both alike but not to the digit: a short drive.
    """
    gate = 200.0
    p = params(model, delay_s=delay_s, delay_jitter_s=0.1, gate=gate, delta_limit_m=np.inf)
    bank, twin = fresh(model), Twin(ORDERS[model], delay_s, gate, jitter_s=0.1)
    rejected = 0
    for t, z, leader in drive(np.random.default_rng(7), duration_s):
        verdict = step(bank, reading(t, *z, leader), p)
        nis, anomalous, x, v = twin.step(t, z, leader)
        assert verdict["anomalous"] == anomalous
        assert abs(verdict["nis"] - nis) < within * (1.0 + nis)
        assert (verdict["x_m"], verdict["v_mps"]) == pytest.approx((x, v), abs=within)
        assert bank[0]["P"] == pytest.approx(twin.covariances[-1], abs=within)
        rejected += anomalous
    assert rejected


@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_without_delay_on_a_linear_road_it_is_the_textbook_kalman_filter(model: str) -> None:
    n, interval_s = ORDERS[model], 0.1
    p = params(model, idm=FREE_LINEAR)
    A = np.array([[0.0, 1.0, 1.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.0]])[:n, :n]
    push = np.array([0.0, 1.0, 0.0])[:n]
    textbook = KalmanFilter(dim_x=n, dim_z=2)
    textbook.F, offset, textbook.Q = discretised(A, push, np.diag([p.q_x, p.q_v, p.q_delta])[:n, :n], interval_s)
    textbook.B = offset.reshape(n, 1)
    textbook.H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[:, :n]
    textbook.R = np.diag([p.r_x, p.r_v])
    textbook.P = p.p0 * np.eye(n)
    bank = fresh(model)
    rng = np.random.default_rng(3)
    for k in range(200):
        z = np.array([0.15 * k, 1.5]) + rng.normal(0.0, 0.1, 2)
        verdict = step(bank, reading(k * interval_s, *z), p)
        if k == 0:
            textbook.x[:2, 0] = z
            continue
        textbook.predict(u=np.array([[1.0]]))
        textbook.update(z.reshape(2, 1))
        assert bank[0]["s"] == pytest.approx(textbook.x[:, 0], abs=1e-6)
        assert bank[0]["P"] == pytest.approx(textbook.P, abs=1e-6)
        assert verdict["nis"] == pytest.approx(
            float((textbook.y.T @ textbook.SI @ textbook.y).item()), rel=1e-4, abs=1e-6
        )


def discretised(A, push, Q, interval_s):
    """Exact transition, offset and noise of s' = A s + push + white noise of density Q (Van Loan 1978)."""
    n = len(A)
    moved = expm(np.block([[A, push[:, None]], [np.zeros((1, n + 1))]]) * interval_s)
    spread = expm(np.block([[-A, Q], [np.zeros((n, n)), A.T]]) * interval_s)
    transition = moved[:n, :n]
    return transition, moved[:n, n], transition @ spread[:n, n:]


def test_the_delayed_equation_is_solved_by_the_method_of_steps() -> None:
    """v' = a - k v(t - tau) from a constant past: a polynomial on each interval of length tau, and x' = v(t - tau)."""
    tau, v0, k = 0.5, 1.0, 0.5
    pieces = [Polynomial([v0])]
    for _ in range(6):
        piece = 1.0 - k * pieces[-1]
        pieces.append(pieces[-1](tau) + piece.integ())
    bank = fresh()
    initialise(bank[0], reading(0.0, 0.0, v0)[0], params(delay_s=tau))
    x = 0.0
    for i, piece in enumerate(pieces[1:], start=1):
        x += pieces[i - 1].integ()(tau)
        predict(bank[0], i * tau, params(delay_s=tau, idm=FREE_LINEAR), SPACE)
        push_own(bank[0], i * tau)
        exact = 1e-12 if i <= 2 else 5e-4
        assert bank[0]["s"] == pytest.approx([x, piece(tau)], abs=exact)


def test_the_delayed_covariance_grows_straight_for_the_first_tau() -> None:
    """P' = F P0 + P0 F' + Q while the past is P0."""
    tau = 0.5
    p = params(delay_s=tau, idm=FREE_LINEAR)
    bank = fresh()
    initialise(bank[0], reading(0.0, 0.0, 1.0)[0], p)
    predict(bank[0], tau, p, SPACE)
    F = np.array([[0.0, 1.0], [0.0, -0.5]])
    assert bank[0]["P"] == pytest.approx(np.eye(2) + tau * (F + F.T + np.diag([p.q_x, p.q_v])), abs=1e-12)


@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_nis_is_chi_square_on_data_drawn_from_the_model(model: str) -> None:
    n, runs, samples, settled, interval_s = ORDERS[model], 60, 120, 40, 0.1
    p = params(model, idm=FREE_LINEAR, delta_limit_m=np.inf)
    A = np.array([[0.0, 1.0, 1.0], [0.0, -0.5, 0.0], [0.0, 0.0, 0.0]])[:n, :n]
    push = np.array([0.0, 1.0, 0.0])[:n]
    Q = np.diag([p.q_x, p.q_v, p.q_delta])[:n, :n]
    transition, offset, noise = discretised(A, push, Q, interval_s)
    root = np.linalg.cholesky(noise)
    H = np.array([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]])[:, :n]
    total = 0.0
    for seed in range(runs):
        rng = np.random.default_rng(seed)
        bank, truth = fresh(model), np.array([0.0, 3.0, 0.0])[:n]
        for k in range(samples):
            verdict = step(bank, reading(k * interval_s, *(H @ truth + rng.normal(0.0, 0.1, 2))), p)
            total += verdict["nis"] if k >= settled else 0.0
            truth = transition @ truth + offset + root @ rng.normal(size=n)
    low, high = chi2.interval(0.999, df=2 * runs * (samples - settled))
    assert low < total < high


def test_a_rejected_reading_leaves_the_prediction() -> None:
    p = params("aekf", delay_s=0.5, gate=9.0)
    bank = fresh("aekf")
    for k in range(30):
        step(bank, reading(0.1 * k, 1.5 * k, 15.0), p)
    alone = bank.copy()
    predict(alone[0], 3.0, p, SPACE)
    verdict = step(bank, reading(3.0, 145.0, 15.0), p)
    assert verdict["anomalous"]
    assert bank[0]["s"] == pytest.approx(alone[0]["s"], abs=0.0)
    assert bank[0]["P"] == pytest.approx(alone[0]["P"], abs=0.0)
    assert verdict["x_m"] == alone[0]["s"][0] + alone[0]["s"][2]


@pytest.mark.parametrize("garbage", ["far", "wild", "nothing"])
@pytest.mark.parametrize("delay_s", [0.0, 0.5, 1.5])
@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_no_garbage_locks_the_filter_out(model: str, delay_s: float, garbage: str) -> None:
    """After any garbage it is back on good readings within `rejections_max` and a few more."""
    rng = np.random.default_rng(5)
    p = params(model, delay_s=delay_s, gate=30.0, rejections_max=10)
    bank = fresh(model)
    outliers = {
        "far": lambda: (5e5, 60.0),
        "wild": lambda: rng.normal(0.0, 1e4, 2),
        "nothing": lambda: (np.nan, np.nan),
    }
    k = 0
    for _ in range(60):
        step(bank, reading(0.1 * k, *outliers[garbage]()), p)
        k += 1
    for _ in range(p.rejections_max + 20):
        verdict = step(bank, reading(0.1 * k, 2.0 * k, 20.0), p)
        k += 1
    assert not verdict["anomalous"]
    assert (verdict["x_m"], verdict["v_mps"]) == pytest.approx((2.0 * (k - 1), 20.0), abs=1.0)


def test_a_silence_beyond_the_gap_initialises_the_row_and_reports_it() -> None:
    p = params("ekf", max_gap_s=5.0)
    bank = fresh()
    step(bank, reading(0.0, 0.0, 10.0), p)
    assert not step(bank, reading(4.9, 49.0, 10.0), p)["restarted"]
    assert step(bank, reading(10.0, 500.0, 3.0), p)["restarted"]
    assert bank[0]["s"] == pytest.approx([500.0, 3.0])


def test_a_sensor_is_named_by_its_own_innovation() -> None:
    p = params("ekf", gate=20.0)
    named = []
    for fault in ((20.0, 0.0), (0.0, 20.0), (20.0, 20.0)):
        bank = fresh()
        for k in range(20):
            step(bank, reading(0.1 * k, 1.5 * k, 15.0), p)
        named.append(int(step(bank, reading(2.0, 30.0 + fault[0], 15.0 + fault[1]), p)["sensor"]))
    assert named == [1, 2, 3]


def test_delta_takes_up_a_constant_slip_and_is_reset_beyond_its_limit() -> None:
    p = params("aekf", delay_s=0.5)
    bank = fresh("aekf")
    delta = []
    for k in range(400):
        step(bank, reading(0.1 * k, (1.0 - 0.03) * k, 10.0), p)
        delta.append(bank[0]["s"][2])
    assert min(delta) < -0.2
    assert max(map(abs, delta)) <= p.delta_limit_m


@pytest.mark.parametrize("n", [2, 3])
def test_repair_lifts_what_is_not_positive_definite_and_leaves_the_rest(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(200):
        root = rng.normal(size=(n, n))
        values = rng.uniform(-1.0, 2.0, n)
        axes = np.linalg.qr(root)[0]
        P = axes @ np.diag(values) @ axes.T
        before = P.copy()
        repaired = repair_covariance(P)
        assert repaired == (values.min() < P_FLOOR)
        assert np.array_equal(P, P.T) or np.allclose(P, P.T, atol=1e-15)
        assert np.linalg.eigvalsh(P).min() > P_FLOOR
        if not repaired:
            assert pytest.approx(before, abs=1e-15) == P


def test_a_batch_updates_each_row_as_if_alone() -> None:
    p = params("aekf", delay_s=0.5, gate=9.0)
    rng = np.random.default_rng(11)
    together = np.zeros(4, paper_dtype(3, DELAY_MAX_S))
    alone = together.copy()
    for k in range(30):
        rows = rng.permutation(4)[:3]
        batch = np.concatenate([reading(0.1 * k, *rng.normal((1.5 * k, 15.0), 0.3)) for _ in rows])
        results = verdicts(3)
        step_batch(together, rows, batch, p, results)
        for row, z, verdict in zip(rows, batch, results, strict=True):
            single = verdicts(1)
            step_row(alone[row], z, p, single[0])
            assert single[0] == verdict
    for name in together.dtype.names:
        np.testing.assert_array_equal(together[name], alone[name])
