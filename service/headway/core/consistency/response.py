"""Test whether a follower responds to its leader as its driver has so far; a self-consistent fault fails this test.

Each driver's response is a linear model with distributed delays. It is learnt for each row by ridge regression with
exponential forgetting, at `tick_s`:

    dv/dt = theta' [1, gap, v, v_leader - v, ln gap | leader's acceleration over the last LAGS ticks] + noise

The first group is as of the previous tick. The residual, measured less predicted, is a speed change without a cause.
Three sums of it, each in its own standard deviations, are computed, and the largest is the statistic:

    step    of the last 2 s, matched with half a sine
    dip     the step less the one of the 2 s before: a speed that leaves and comes back
    drift   with time constant DRIFT_S: a speed that ignores the changes of the leader's speed

A response is never exact, so the variance of a sum grows with the manoeuvre that was answered:

    variance = learnt + (ANSWER_SPREAD answered)^2    answered = min(|measured|, |predicted|) if of one sign, else 0

The fault may be the follower's (a speed change without a cause) or the leader's (a cause without a response). For the
attribution, each step tells a response to the leader from a natural motion that is unrelated to it:

    LLR = ln N(measured; 0, natural variance) - ln N(measured; predicted, residual variance)

So a hard brake with an inexact response still clears the leader. The pair itself only shows a motion surprise: a speed
change beyond the natural one, or a constant speed where the driver seldom keeps one. A tick above the gate is not
learnt, and one near it has less weight.
"""

from math import exp, isnan, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.consistency.attribution import FAULT_LOG_ODDS, accumulate
from headway.core.statistics import alarm_gate
from headway.core.statistics.ridge_regression import ridge_learn, ridge_solve

STATE_COLUMNS, LAGS = 5, 6
COLUMNS = STATE_COLUMNS + LAGS
SPAN = 5
"""Ticks of a pulse: 2 s, half of a braking manoeuvre."""
PULSE = (0.4, 1.047, 1.294, 1.047, 0.4)
"""Half a sine over SPAN, scaled so that the sum of a speed change of that shape is the speed change."""

DRIFT_S = 8.0
"""Time constant of the drift."""
ANSWER_SPREAD = 0.5
"""Standard deviation of a response, as a share of it."""

GAP_SCALE_M, SPEED_SCALE_MPS = 20.0, 10.0
"""Scales that bring the regressors to the order of one, for a common ridge."""
GAP_FLOOR_M = 0.5
MEAN_DRIVER = (-0.1, 0.34, -0.16, 0.19, 0.01, 0.12, 0.0, 0.02, 0.15, 0.06, 0.24)
"""Prior of theta: the mean over drivers of four collections, each of the same weight (humans and adaptive cruise
control). Leaving any collection out moves no entry by more than 0.22."""
SUMS, DRIFT = 3, 2
TYPICAL_MPS = (0.6, 0.6, 1.0)
"""Priors of the spreads of step, dip and drift of the residual."""
TYPICAL_MOTION_MPS, TYPICAL_STILL = (1.0, 1.0, 2.0), 0.1
"""Priors of the spreads of the measured motion, and of the share of ticks without a speed change."""
SPREAD_FLOOR_MPS = (0.2, 0.2, 0.6)
"""Lower bounds of the spreads."""
SURPRISE_SIGMA = 2.0
"""Natural standard deviations at which a speed change is as likely a fault: natural motion has heavy tails."""
STILL_MPS, STILL_SHARE_MIN, FROZEN_SHARE = 0.05, 0.01, 0.25
"""A speed is constant if it changes by less than STILL_MPS in each tick. STILL_SHARE_MIN bounds the share of constant
speed of a driver from below; FROZEN_SHARE is that share among known faults."""
OUTLIER = 3.0
"""Standard deviations at which the weight of a tick decreases, and squares are clipped."""
SOLVE_EVERY = 5
"""Ticks between two solutions for theta, which changes over minutes."""
WINDOW_TICKS = LAGS + 2 * SPAN
"""Consecutive ticks that fill the sums."""

RESPONSE = np.dtype(
    [
        ("learning_time_s", "f8"),  # 0: a new row
        ("t_s", "f8"),  # of the last tick
        ("v_mps", "f8"),
        ("leader_t_s", "f8"),
        ("leader_v_mps", "f8"),
        ("ticks", "i8"),  # consecutive, the last one included
        ("regressors", "f8", (STATE_COLUMNS,)),  # first group of regressors at the last tick
        ("leader_a_mps2", "f8", (LAGS,)),  # newest first
        ("A", "f8", (COLUMNS * (COLUMNS + 1) // 2,)),
        ("b", "f8", (COLUMNS,)),
        ("theta", "f8", (COLUMNS,)),
        ("measured_mps", "f8", (2 * SPAN,)),  # speed changes tick by tick, newest first
        ("predicted_mps", "f8", (2 * SPAN,)),  # by the model
        ("measured_drift_mps", "f8"),
        ("predicted_drift_mps", "f8"),
        ("residual_ms", "f8", (SUMS,)),  # mean square of the residual sums, less answer_spread_ms
        ("natural_ms", "f8", (SUMS,)),  # mean square of the same sums of measured_mps
        ("exceedance_time_s", "f8"),  # recent time above the gate less time below
        ("tail", alarm_gate.TAIL),
        ("statistic", "f8"),
        ("gate", "f8"),
        ("still_share", "f8", (2,)),  # share of ticks of constant speed: follower, leader
        ("follower_surprise", "f8"),  # log odds against natural motion
        ("leader_surprise", "f8"),  # of the leader, by the predicted response
        ("pair_fault", FAULT_LOG_ODDS),
    ],
    align=True,
)
"""State of one driver; all zeros is a driver without a reading."""


class ResponseParams(NamedTuple):
    """Parameters of the response test."""

    budget: alarm_gate.Budget
    tick_s: float = 0.4
    memory_s: float = 120.0
    """Time constant of forgetting."""
    warming_s: float = 45.0
    """Learning time before verdicts count: about a hundred ticks for eleven coefficients and two spreads."""
    ridge_s: float = 10.0
    """Weight of the prior of theta, in seconds of regressors of one."""
    spread_s: float = 40.0
    """Weight of the priors of the spreads, in seconds."""
    relearn_after_s: float = 20.0
    """Exceedance time after which the current driving is learnt as this driver's own."""
    max_gap_s: float = 1.2
    """A longer gap resets the sums; what was learnt stays."""


@njit(cache=True, error_model="numpy")
def response_reset_leader(row: Any) -> None:
    """Reset the sums for another leader; what was learnt of the driver stays."""
    row.ticks, row.statistic, row.exceedance_time_s = 0, 0.0, 0.0
    row.measured_drift_mps, row.predicted_drift_mps, row.follower_surprise, row.leader_surprise = 0.0, 0.0, 0.0, 0.0
    row.pair_fault.log_odds, row.pair_fault.t_s = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def push(ring: Any, newest: float) -> None:
    """Put `newest` first and drop the last."""
    for k in range(ring.size - 1, 0, -1):
        ring[k] = ring[k - 1]
    ring[0] = newest


@njit(cache=True, error_model="numpy")
def store_regressors(row: Any, z: Any, gap_m: float) -> None:
    """Store the regressors of this tick for the next."""
    gap = max(gap_m, GAP_FLOOR_M)
    row.regressors[0] = 1.0
    row.regressors[1] = gap / GAP_SCALE_M
    row.regressors[2] = z.v_mps / SPEED_SCALE_MPS
    row.regressors[3] = z.leader_v_mps - z.v_mps
    row.regressors[4] = log(gap)
    row.t_s, row.v_mps = z.t_s, z.v_mps
    row.leader_t_s, row.leader_v_mps = z.leader_t_s, z.leader_v_mps
    row.ticks += 1


@njit(cache=True, error_model="numpy")
def sums(row: Any) -> Any:
    """Return (measured, predicted) of step, dip and drift, m/s."""
    measured, predicted, measured_before, predicted_before = 0.0, 0.0, 0.0, 0.0
    for k in range(SPAN):
        measured += PULSE[k] * row.measured_mps[k]
        predicted += PULSE[k] * row.predicted_mps[k]
        measured_before += PULSE[k] * row.measured_mps[SPAN + k]
        predicted_before += PULSE[k] * row.predicted_mps[SPAN + k]
    return (
        (measured, predicted),
        (measured - measured_before, predicted - predicted_before),
        (row.measured_drift_mps, row.predicted_drift_mps),
    )


@njit(cache=True, error_model="numpy")
def answer_spread_ms(measured: float, predicted: float) -> float:
    """Return the variance that comes with the manoeuvre that was answered, (m/s)^2."""
    return (ANSWER_SPREAD * min(abs(measured), abs(predicted))) ** 2 if measured * predicted > 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def is_still(row: Any, p: ResponseParams) -> tuple[bool, bool]:
    """Return whether the reported speeds of follower and leader are constant."""
    follower, leader = True, True
    for k in range(LAGS):
        follower = follower and abs(row.measured_mps[k]) < STILL_MPS
        leader = leader and abs(row.leader_a_mps2[k]) * p.tick_s < STILL_MPS
    return follower, leader


@njit(cache=True, error_model="numpy")
def update_statistic(row: Any, p: ResponseParams) -> None:
    """Write statistic, gate and motion surprises from the sums."""
    row.gate = alarm_gate.gate(row.tail, p.budget)
    row.statistic = 0.0
    for which, (measured, predicted) in enumerate(sums(row)):
        floor = SPREAD_FLOOR_MPS[which] ** 2
        z = abs(measured - predicted) / sqrt(row.residual_ms[which] + floor + answer_spread_ms(measured, predicted))
        row.statistic = max(row.statistic, z)
        if which < DRIFT and z == row.statistic:
            row.follower_surprise = 0.5 * measured**2 / (SURPRISE_SIGMA**2 * (row.natural_ms[which] + floor))
            row.leader_surprise = 0.5 * predicted**2 / (SURPRISE_SIGMA**2 * (row.natural_ms[which] + floor))
    follower_still, leader_still = is_still(row, p)
    if follower_still:
        row.follower_surprise += max(log(FROZEN_SHARE / max(row.still_share[0], STILL_SHARE_MIN)), 0.0)
    if leader_still:
        row.leader_surprise += max(log(FROZEN_SHARE / max(row.still_share[1], STILL_SHARE_MIN)), 0.0)


@njit(cache=True, error_model="numpy")
def accumulate_answer(row: Any, t_s: float, dt_s: float, p: ResponseParams) -> None:
    """Add the log-likelihood ratio of the step, unrelated motion against response, to the fault log odds."""
    measured, predicted = sums(row)[0]
    residual, natural = row.residual_ms[0] + SPREAD_FLOOR_MPS[0] ** 2, row.natural_ms[0] + SPREAD_FLOOR_MPS[0] ** 2
    answer = (measured - predicted) ** 2 / residual + log(residual)
    unrelated = measured**2 / natural + log(natural)
    accumulate(row.pair_fault, 0.5 * (answer - unrelated), dt_s / (SPAN * p.tick_s), t_s)


@njit(cache=True, error_model="numpy")
def learn_spread(row: Any, dt_s: float, p: ResponseParams) -> None:
    """Learn the spreads of motion and residual; each square is clipped at OUTLIER standard deviations."""
    share = dt_s / min(p.spread_s + row.learning_time_s, p.memory_s)
    for which, still in enumerate(is_still(row, p)):
        row.still_share[which] += share * (still - row.still_share[which])
    for which, (measured, predicted) in enumerate(sums(row)):
        floor, residual, natural = SPREAD_FLOOR_MPS[which] ** 2, row.residual_ms[which], row.natural_ms[which]
        unexplained = max((measured - predicted) ** 2 - answer_spread_ms(measured, predicted), 0.0)
        row.residual_ms[which] += share * (min(unexplained, OUTLIER**2 * (residual + floor)) - residual)
        row.natural_ms[which] += share * (min(measured**2, OUTLIER**2 * (natural + floor)) - natural)


@njit(cache=True, error_model="numpy")
def tick(row: Any, z: Any, dt_s: float, p: ResponseParams) -> None:
    """Run one step of the regression: predict, compare, test, learn."""
    leader_dt_s = z.leader_t_s - row.leader_t_s
    push(row.leader_a_mps2, (z.leader_v_mps - row.leader_v_mps) / leader_dt_s if leader_dt_s > 0.5 * dt_s else 0.0)
    phi = np.empty(COLUMNS)
    for k in range(STATE_COLUMNS):
        phi[k] = row.regressors[k]
    for k in range(LAGS):
        phi[STATE_COLUMNS + k] = row.leader_a_mps2[k]
    predicted = 0.0
    for k in range(COLUMNS):
        predicted += phi[k] * row.theta[k]
    measured = z.v_mps - row.v_mps
    push(row.measured_mps, measured)
    push(row.predicted_mps, predicted * dt_s)
    decay = exp(-dt_s / DRIFT_S)
    row.measured_drift_mps = decay * row.measured_drift_mps + measured
    row.predicted_drift_mps = decay * row.predicted_drift_mps + predicted * dt_s
    if row.ticks < LAGS:
        return
    if row.learning_time_s == 0.0:
        row.theta[:] = MEAN_DRIVER
        row.still_share[:] = TYPICAL_STILL
        for which in range(SUMS):
            row.residual_ms[which] = TYPICAL_MPS[which] ** 2
            row.natural_ms[which] = TYPICAL_MOTION_MPS[which] ** 2
    row.learning_time_s += dt_s
    if row.ticks >= WINDOW_TICKS:
        update_statistic(row, p)
        if row.learning_time_s > p.warming_s:
            accumulate_answer(row, z.t_s, dt_s, p)
            beyond = row.statistic > row.gate
            alarm_gate.learn(row.tail, row.statistic, beyond, dt_s, p.budget)
            row.exceedance_time_s = min(
                max(row.exceedance_time_s + (dt_s if beyond else -dt_s), 0.0), p.relearn_after_s
            )
            if beyond and row.exceedance_time_s < p.relearn_after_s:
                return
        learn_spread(row, dt_s, p)
    weight = dt_s * min(1.0, (OUTLIER / max(row.statistic, OUTLIER)) ** 2)
    ridge_learn(row.A, row.b, phi, measured / dt_s, exp(-dt_s / p.memory_s), weight)
    if row.ticks % SOLVE_EVERY == 0:
        ridge_solve(row.A, row.b, p.ridge_s, MEAN_DRIVER, row.theta)


@njit(cache=True, error_model="numpy")
def response_step(row: Any, z: Any, p: ResponseParams, check: Any) -> None:
    """Update one RESPONSE row with one READING and write the CHECK.

    Between ticks the last result holds. Without a leader the check is `warming`. A gap in the leader's messages of up
    to `max_gap_s` has no effect.
    """
    check.statistic, check.p_value = 0.0, 1.0
    check.warming, check.anomalous = True, False
    if isnan(z.leader_t_s):
        return
    dt_s = z.t_s - row.t_s
    running = row.ticks > 0 and dt_s <= p.max_gap_s
    if not running or dt_s > 0.875 * p.tick_s:
        gap_m = z.leader_x_m + z.leader_v_mps * (z.t_s - z.leader_t_s) - z.leader_length_m - z.x_m
        if running:
            tick(row, z, dt_s, p)
        else:
            response_reset_leader(row)
        store_regressors(row, z, gap_m)
    check.statistic = row.statistic
    check.gate = row.gate
    rate_per_hour = alarm_gate.false_alarms_per_hour(row.tail, row.statistic, p.budget)
    check.p_value = min(1.0, rate_per_hour * p.tick_s / 3600.0)
    check.warming = row.learning_time_s <= p.warming_s or row.ticks <= WINDOW_TICKS
    check.anomalous = not check.warming and row.statistic > row.gate
