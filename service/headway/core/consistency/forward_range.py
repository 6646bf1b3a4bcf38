"""Compare the location and speed of two vehicles with what the follower's forward sensor measures between them.

    range      = (x_leader - length - x) + offset_m + noise
    range rate = (v_leader - v) + offset_mps + noise

The offsets depend on the reference points of the two locations and on the mounting of the sensor. They are constants of
the pair and are learnt, and so are the spreads, which include the slow error of satellite positions. Both disagreements
are averaged over `SMOOTH_S` (Roberts 1959, exponentially weighted moving average chart), so a slow fault adds up and a
single outlier does not count. The statistic is the root of the sum of their squares, each in standard deviations. The
disagreement does not show which of the two vehicles is faulty. For the attribution, a fault makes its spread
FAULT_SPREAD times as large.
"""

from math import exp, isnan, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.consistency.attribution import FAULT_LOG_ODDS, accumulate
from headway.core.statistics import alarm_gate

SMOOTH_S = 0.5
SPREAD_FLOOR = (0.3, 0.1)
"""Lower bounds of the spreads, m and m/s."""
LEADER_ACCEL_MPS2 = 1.0
"""Bound of the leader's acceleration since its last sample."""
OUTLIER = 3.0
"""Standard deviations at which a disagreement is clipped before it is learnt."""
FAULT_SPREAD = 3.0
"""Standard deviations of the disagreement under a fault."""
SETTLE_S = 2.0
"""Learning time before the spreads clip and the statistic counts."""

RANGING = np.dtype(
    [
        ("learning_time_s", "f8"),  # 0: a new pair
        ("t_s", "f8"),
        ("offset", "f8", (2,)),  # m, m/s
        ("mean_disagreement", "f8", (2,)),  # over SMOOTH_S; m, m/s
        ("mean_square", "f8", (2,)),  # of mean_disagreement
        ("exceedance_time_s", "f8"),  # time above the gate
        ("tail", alarm_gate.TAIL),
        ("pair_fault", FAULT_LOG_ODDS),
    ],
    align=True,
)
"""State of one pair; all zeros is a pair without a range."""


class RangingParams(NamedTuple):
    """Parameters of the range test."""

    budget: alarm_gate.Budget
    memory_s: float = 120.0
    warming_s: float = 10.0
    max_gap_s: float = 1.2
    relearn_after_s: float = 60.0
    """Time above the gate after which the pair is learnt again: the sensor sees another vehicle or was moved."""


@njit(cache=True, error_model="numpy")
def ranging_reset_leader(row: Any) -> None:
    """Reset for another leader, whose offsets differ."""
    row.learning_time_s = 0.0
    row.pair_fault.log_odds, row.pair_fault.t_s = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def initialise(row: Any, t_s: float) -> None:
    """Initialise a pair; the tail of its statistic stays."""
    row.learning_time_s, row.t_s, row.exceedance_time_s = 0.0, t_s, 0.0
    row.offset[:] = 0.0
    row.mean_disagreement[:] = 0.0
    row.mean_square[:] = 0.0
    row.pair_fault.log_odds, row.pair_fault.t_s = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def ranging_step(row: Any, z: Any, p: RangingParams, check: Any) -> None:
    """Update one RANGING row with one READING and write the CHECK; `warming` without a leader or a range."""
    check.statistic, check.p_value = 0.0, 1.0
    check.warming, check.anomalous = True, False
    if isnan(z.leader_t_s) or isnan(z.range_m):
        return
    if row.learning_time_s == 0.0 or row.exceedance_time_s > p.relearn_after_s:
        initialise(row, z.t_s - 0.1)
    dt_s = min(z.t_s - row.t_s, p.max_gap_s)
    row.t_s = z.t_s
    age_s = z.t_s - z.leader_t_s
    gap_m = z.leader_x_m + z.leader_v_mps * age_s - z.leader_length_m - z.x_m
    gap_rate_mps = z.leader_v_mps - z.v_mps
    disagreement = (z.range_m - gap_m, gap_rate_mps if isnan(z.range_rate_mps) else z.range_rate_mps - gap_rate_mps)
    row.learning_time_s += dt_s
    share = dt_s / min(row.learning_time_s, p.memory_s)
    settled = row.learning_time_s > SETTLE_S
    extrapolation = (0.5 * LEADER_ACCEL_MPS2 * age_s**2, LEADER_ACCEL_MPS2 * age_s)
    squares = 0.0
    for k in range(2):
        row.mean_disagreement[k] += (1.0 - exp(-dt_s / SMOOTH_S)) * (
            disagreement[k] - row.offset[k] - row.mean_disagreement[k]
        )
        squares += row.mean_disagreement[k] ** 2 / (row.mean_square[k] + SPREAD_FLOOR[k] ** 2 + extrapolation[k] ** 2)
    if settled:
        check.statistic = sqrt(squares)
    check.gate = alarm_gate.gate(row.tail, p.budget)
    rate_per_hour = alarm_gate.false_alarms_per_hour(row.tail, check.statistic, p.budget)
    check.p_value = min(1.0, rate_per_hour * dt_s / 3600.0)
    check.warming = row.learning_time_s < p.warming_s
    check.anomalous = not check.warming and check.statistic > check.gate
    if not check.warming:
        spread = 1.0 + FAULT_SPREAD**2
        log_likelihood_ratio = 0.5 * squares * (1.0 - 1.0 / spread) - log(spread)
        accumulate(row.pair_fault, log_likelihood_ratio, 1.0, z.t_s)
        alarm_gate.learn(row.tail, check.statistic, check.anomalous, dt_s, p.budget)
    if check.anomalous:
        row.exceedance_time_s += dt_s
        return
    row.exceedance_time_s = 0.0
    for k in range(2):
        cut = OUTLIER * sqrt(row.mean_square[k] + SPREAD_FLOOR[k] ** 2) if settled else np.inf
        row.offset[k] += share * min(max(disagreement[k] - row.offset[k], -cut), cut)
        row.mean_square[k] += share * (min(row.mean_disagreement[k] ** 2, cut**2) - row.mean_square[k])
