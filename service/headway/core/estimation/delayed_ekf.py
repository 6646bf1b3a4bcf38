"""The paper's filters on a delayed car-following model: predict, innovate, update, and the row kernel.

Source: Wang, Masoud, Khojandi 2020 (arXiv:2004.09496), equations `augmented`, `predict`, `update`, `gate`.
Model 1 (`ekf`) has s = [x, v]; Model 2 (`aekf`) has s~ = [x, v, delta]:

    g(s, u) = [v + delta, f_v([x, v], u), 0]           F = dg/ds = [[0, 1, 1], [f_x, f_v', 0], [0, 0, 0]]
    s'(t) = g(s(t - tau), u(t - tau))
    P'(t) = F P(t - tau) + P(t - tau) F' + Q           F at the delayed state and input
    H     = [[1, 0, 1], [0, 1, 0]]                     without the third column and row for Model 1

With tau > 0 the right-hand sides are known functions of time (method of steps), and Simpson's rule integrates them.
With tau = 0 they are an ordinary equation, and the classical Runge-Kutta rule integrates it. The delayed covariance
equation does not keep P positive definite: `repair_covariance` restores that and reports it.
"""

from math import ceil, exp, isnan, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.car_following import IdmParams, idm
from headway.core.estimation.delay_buffers import input_at, own_at, push_input, push_own
from headway.core.statistics.fault_shape import add_deviation, end_episode, likeliest_kind
from headway.core.statistics.innovation import Innovation, conditional_variance, nis_2d
from headway.core.types.records import Sensor

SUBSTEP_S = 0.1
"""Longest step of the integration, s: the nominal interval of SAE J2945/1."""
SUBSTEPS_MAX = 64
P_FLOOR = 1e-6
"""Least eigenvalue of a repaired P: a millimetre and a millimetre per second, squared."""
P_CEILING = 1e6
"""Largest entry of P: a kilometre and a kilometre per second, squared."""

SENSOR_LOCATION, SENSOR_SPEED, SENSOR_BOTH = int(Sensor.LOCATION), int(Sensor.SPEED), int(Sensor.BOTH)


class FilterParams(NamedTuple):
    """Numbers of Model 1 and Model 2 as published: Q per second, R per reading."""

    idm: IdmParams
    delay_s: float
    """tau, s."""
    delay_jitter_s: float
    """sigma_1: standard deviation of a stochastic delay, s."""
    gate: float
    """sigma: threshold of nis."""
    sensor_gate: float
    """Threshold of one sensor's own squared, normalised innovation."""
    q_x: float
    q_v: float
    q_delta: float
    """Diagonal of Q, m^2/s, (m/s)^2/s, m^2/s."""
    r_x: float
    r_v: float
    """Diagonal of R, m^2, (m/s)^2."""
    p0: float
    """Diagonal of P at the first reading, m^2, (m/s)^2, m^2."""
    delta_limit_m: float
    """A larger delta is reset to zero, as published."""
    max_gap_s: float
    """A longer silence initialises the filter again."""
    warming_readings: int
    rejections_max: int
    """Rejections in a row after which the filter is initialised at the reading, so that it is never locked out."""


WORKSPACE = np.dtype(
    [
        ("s", "f8", (3,)),
        ("P", "f8", (3, 3)),
        ("ds", "f8", (3,)),
        ("dP", "f8", (3, 3)),
        ("sum_s", "f8", (3,)),
        ("sum_P", "f8", (3, 3)),
        ("PH", "f8", (3, 2)),
        ("K", "f8", (3, 2)),
    ],
    align=True,
)
"""What a step works in, for a state of at most three: a record, because its parts are not counted references."""


@njit(cache=True, error_model="numpy")
def rates(row: Any, at: float, s: Any, P: Any, p: FilterParams, ds: Any, dP: Any) -> None:
    """Write g and F P + P F' + Q into the first n of `ds` and `dP`, for s, P and the input of time `at`."""
    n = row.s.size
    rear_leader, v_leader, a_leader = input_at(row, at)
    f, f_x, f_v, f_vl = idm(rear_leader - s[0], s[1], v_leader, p.idm)
    ds[0] = s[1]
    ds[1] = f
    if n == 3:
        ds[0] += s[2]
        ds[2] = 0.0
    # F P, row by row; dP = F P + (F P)' + Q.
    for b in range(n):
        dP[0, b] = P[1, b]
        dP[1, b] = f_x * P[0, b] + f_v * P[1, b]
        if n == 3:
            dP[0, b] += P[2, b]
            dP[2, b] = 0.0
    for a in range(n):
        for b in range(a, n):
            both = dP[a, b] + dP[b, a]
            dP[a, b] = both
            dP[b, a] = both
    dP[0, 0] += p.q_x
    dP[1, 1] += p.q_v
    if n == 3:
        dP[2, 2] += p.q_delta
    if p.delay_jitter_s > 0.0 and not isnan(rear_leader):
        # stochastic-delay: u is uncertain along its own change, [v_leader, a_leader] kappa; only f_v sees u.
        dP[1, 1] += (p.delay_jitter_s * (-f_x * v_leader + f_vl * a_leader)) ** 2


@njit(cache=True, error_model="numpy")
def repair_covariance(P: Any) -> bool:
    """Make P symmetric and positive definite in place; return whether more than symmetry had to be repaired.

    A covariance beyond `P_CEILING`, as after a long gap behind a close leader, holds no knowledge and is reset to it.
    """
    n = P.shape[0]
    for a in range(n):
        for b in range(n):
            if not abs(P[a, b]) < P_CEILING:  # infinity and NaN are not below it either
                P[:, :] = P_CEILING * np.eye(n)
                return True
    for a in range(n):
        for b in range(a):
            mean = 0.5 * (P[a, b] + P[b, a])
            P[a, b] = mean
            P[b, a] = mean
    # Leading minors of P - floor I (Sylvester): cheap, and nearly always enough.
    m00, m11 = P[0, 0] - P_FLOOR, P[1, 1] - P_FLOOR
    minor = m00 * m11 - P[0, 1] ** 2
    sound = m00 > 0.0 and minor > 0.0
    if sound and n == 3:
        m22 = P[2, 2] - P_FLOOR
        det = (
            m22 * minor - P[1, 2] * (m00 * P[1, 2] - P[0, 1] * P[0, 2]) + P[0, 2] * (P[0, 1] * P[1, 2] - m11 * P[0, 2])
        )
        sound = det > 0.0
    if sound:
        return False
    values, vectors = np.linalg.eigh(P)
    lifted = np.maximum(values, 2.0 * P_FLOOR)
    P[:, :] = (vectors * lifted) @ vectors.T
    return True


@njit(cache=True, error_model="numpy")
def add_weighted(n: int, sum_s: Any, sum_P: Any, weight: float, ds: Any, dP: Any) -> None:
    """Add weighted rates to their sums."""
    for a in range(n):
        sum_s[a] += weight * ds[a]
        for b in range(n):
            sum_P[a, b] += weight * dP[a, b]


@njit(cache=True, error_model="numpy")
def predict(row: Any, t_s: float, p: FilterParams, workspace: Any) -> bool:
    """Integrate s and P of the row from row.t_s to `t_s`; return whether P had to be repaired."""
    n = row.s.size
    tau = p.delay_s
    longest = SUBSTEP_S if tau == 0.0 else min(SUBSTEP_S, tau)
    steps = min(SUBSTEPS_MAX, max(1, ceil((t_s - row.t_s) / longest - 1e-6)))
    h = (t_s - row.t_s) / steps
    start = row.t_s
    s, P, ds, dP, sum_s, sum_P = workspace.s, workspace.P, workspace.ds, workspace.dP, workspace.sum_s, workspace.sum_P
    ds[:] = 0.0
    dP[:, :] = 0.0
    for step in range(steps):
        t = start + step * h
        sum_s[:] = 0.0
        sum_P[:, :] = 0.0
        if tau == 0.0:
            for stage in range(4):
                c = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
                for a in range(n):
                    s[a] = row.s[a] + c * h * ds[a]
                    for b in range(n):
                        P[a, b] = row.P[a, b] + c * h * dP[a, b]
                rates(row, t + c * h, s, P, p, ds, dP)
                weight = 1.0 if stage in (0, 3) else 2.0
                add_weighted(n, sum_s, sum_P, weight, ds, dP)
        else:
            for stage in range(3):
                at = t + 0.5 * stage * h - tau
                own_at(row, at, s, P)
                rates(row, at, s, P, p, ds, dP)
                weight = 4.0 if stage == 1 else 1.0
                add_weighted(n, sum_s, sum_P, weight, ds, dP)
        for a in range(n):
            row.s[a] += h / 6.0 * sum_s[a]
            for b in range(n):
                row.P[a, b] += h / 6.0 * sum_P[a, b]
        if tau > 0.0 and step < steps - 1:
            push_own(row, t + h)
    row.t_s = t_s
    return repair_covariance(row.P)


@njit(cache=True, error_model="numpy")
def observed(row: Any) -> tuple[float, float]:
    """Return H s, what the sensors should read."""
    x = row.s[0] + row.s[2] if row.s.size == 3 else row.s[0]
    return x, row.s[1]


@njit(cache=True, error_model="numpy")
def observed_covariance(row: Any) -> tuple[float, float, float]:
    """Return H P H' as (position, covariance, speed)."""
    P = row.P
    if row.s.size == 3:
        return P[0, 0] + 2.0 * P[0, 2] + P[2, 2], P[0, 1] + P[2, 1], P[1, 1]
    return P[0, 0], P[0, 1], P[1, 1]


@njit(cache=True, error_model="numpy")
def innovate(row: Any, z_x: float, z_v: float, p: FilterParams) -> Innovation:
    """Return nu = z - H s and S = H P H' + R of a reading, by the prediction in the row."""
    x, v = observed(row)
    c_xx, c_xv, c_vv = observed_covariance(row)
    s_xx, s_xv, s_vv = c_xx + p.r_x, c_xv, c_vv + p.r_v
    nu_x, nu_v = z_x - x, z_v - v
    return Innovation(nu_x, nu_v, s_xx, s_xv, s_vv, nis_2d(nu_x, nu_v, s_xx, s_xv, s_vv, p.r_v))


@njit(cache=True, error_model="numpy")
def update(row: Any, innovation: Innovation, p: FilterParams, workspace: Any) -> bool:
    """K = P H' S^-1; s += K nu; P -= K S K'. Return whether P had to be repaired."""
    n = row.s.size
    nu_x, nu_v, s_xx, s_xv, s_vv, _ = innovation
    det = s_xx * conditional_variance(s_xx, s_xv, s_vv, p.r_v)
    i_xx, i_xv, i_vv = s_vv / det, -s_xv / det, s_xx / det
    PH, K = workspace.PH, workspace.K
    for a in range(n):
        PH[a, 0] = row.P[a, 0] + row.P[a, 2] if n == 3 else row.P[a, 0]
        PH[a, 1] = row.P[a, 1]
        K[a, 0] = PH[a, 0] * i_xx + PH[a, 1] * i_xv
        K[a, 1] = PH[a, 0] * i_xv + PH[a, 1] * i_vv
    for a in range(n):
        row.s[a] += K[a, 0] * nu_x + K[a, 1] * nu_v
        for b in range(n):
            row.P[a, b] -= K[a, 0] * PH[b, 0] + K[a, 1] * PH[b, 1]
    return repair_covariance(row.P)


@njit(cache=True, error_model="numpy")
def initialise(row: Any, z: Any, p: FilterParams) -> None:
    """Initialise the filter at a reading: s = z, delta = 0, P = P0, with an empty past."""
    row.t_s = z.t_s
    row.s[:] = 0.0
    row.s[0] = z.x_m
    row.s[1] = z.v_mps
    row.P[:, :] = 0.0
    for a in range(row.s.size):
        row.P[a, a] = p.p0
    row.own_count = 0
    row.rejections = 0
    end_episode(row.episode)
    push_own(row, z.t_s)


@njit(cache=True, error_model="numpy")
def push_leader(row: Any, z: Any) -> None:
    """Store the leader's newest sample in the ring of inputs; no leader is stored as NaN."""
    if isnan(z.leader_t_s):
        push_input(row, z.t_s, z.leader_t_s, z.leader_t_s)
    else:
        push_input(row, z.leader_t_s, z.leader_x_m - z.leader_length_m, z.leader_v_mps)


@njit(cache=True, error_model="numpy")
def isolate(innovation: Innovation, sensor_gate: float) -> int:
    """Return the `Sensor` whose own innovation exceeds its gate; both, if both or only their combination do."""
    nu_x, nu_v, s_xx, _, s_vv, _ = innovation
    x_faulty = nu_x * nu_x > sensor_gate * s_xx
    v_faulty = nu_v * nu_v > sensor_gate * s_vv
    if x_faulty == v_faulty:
        return SENSOR_BOTH
    return SENSOR_LOCATION if x_faulty else SENSOR_SPEED


@njit(cache=True, error_model="numpy")
def reject(row: Any, z: Any, innovation: Innovation, p: FilterParams, verdict: Any) -> None:
    """Write sensor and kind of a rejected reading; initialise the row after too many of them."""
    nu_x, nu_v, s_xx, _, s_vv, _ = innovation
    row.rejections += 1
    verdict.sensor = isolate(innovation, p.sensor_gate)
    by_speed = nu_v**2 * s_xx > nu_x**2 * s_vv
    add_deviation(row.episode, nu_v if by_speed else nu_x)
    verdict.kind, verdict.confidence = likeliest_kind(row.episode, p.r_v if by_speed else p.r_x)
    if row.rejections < p.rejections_max:
        push_own(row, z.t_s)
    else:
        verdict.restarted = True
        initialise(row, z, p)


@njit(cache=True, error_model="numpy")
def write_test(verdict: Any, innovation: Innovation, gate: float) -> None:
    """Write innovation and chi-square test to the VERDICT: P(chi^2_2 > nis) = exp(-nis / 2)."""
    verdict.nis = verdict.statistic = innovation.nis
    verdict.gate = gate
    verdict.p_value = exp(-0.5 * innovation.nis)
    verdict.nu[0], verdict.nu[1] = innovation.nu_x, innovation.nu_v
    verdict.S[0, 0], verdict.S[1, 1] = innovation.s_xx, innovation.s_vv
    verdict.S[0, 1] = verdict.S[1, 0] = innovation.s_xv


@njit(cache=True, error_model="numpy")
def step(row: Any, z: Any, p: FilterParams, verdict: Any, workspace: Any) -> None:
    """Update one row by one READING, in place, and write the VERDICT.

    A rejected reading does not update the state: the prediction is the recovered value.
    """
    push_leader(row, z)
    if row.count == 0 or z.t_s - row.t_s > p.max_gap_s:
        verdict.restarted = row.count > 0
        row.count = 0
        initialise(row, z, p)
        innovation = Innovation(0.0, 0.0, p.p0 + p.r_x, 0.0, p.p0 + p.r_v, 0.0)
    else:
        verdict.repaired = predict(row, z.t_s, p, workspace)
        innovation = innovate(row, z.x_m, z.v_mps, p)
        # A nis that is not a number is anomalous: the reading is rejected, and the row is initialised again in the end.
        verdict.anomalous = row.count >= p.warming_readings and not innovation.nis <= p.gate
        if verdict.anomalous:
            reject(row, z, innovation, p, verdict)
        else:
            row.rejections = 0
            end_episode(row.episode)
            verdict.repaired |= update(row, innovation, p, workspace)
            if row.s.size == 3 and abs(row.s[2]) > p.delta_limit_m:
                row.s[2] = 0.0
            push_own(row, z.t_s)
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    write_test(verdict, innovation, p.gate)
    verdict.x_m, verdict.v_mps = observed(row)
    c_xx, _, c_vv = observed_covariance(row)
    verdict.x_std_m = sqrt(c_xx)
    verdict.v_std_mps = sqrt(c_vv)


@njit(cache=True, error_model="numpy")
def step_row(row: Any, z: Any, p: FilterParams, verdict: Any) -> None:
    """Update one row by one reading."""
    workspace = np.zeros(1, WORKSPACE)
    for place in range(workspace.size):  # the loop keeps the array alive, which a record does not
        step(row, z, p, verdict, workspace[place])


@njit(cache=True, error_model="numpy")
def step_batch(bank: Any, rows: Any, readings: Any, p: FilterParams, verdicts: Any) -> None:
    """`step_row` for each of the distinct `rows` (B,), with `readings` and `verdicts` (B,): one call for a batch."""
    workspace = np.zeros(1, WORKSPACE)
    for i in range(rows.size):
        step(bank[rows[i]], readings[i], p, verdicts[i], workspace[0])
