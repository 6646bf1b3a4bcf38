"""Location and speed of two cars against what the follower's forward sensor measures between them.

    range      = (x_leader - length - x) + offset_m + noise
    range rate = (v_leader - v) + offset_mps + noise

The offsets (where on each car its location refers to, where the sensor sits) are constants of the pair and are learnt;
so are the spreads, which hold the slow wander of satellite positions as well. Both disagreements are averaged over
`SMOOTH_S` (Roberts 1959, the exponentially weighted moving average chart), so that a slow lie adds up and one bad
reading does not count; the root of the sum of their squares, each in its own standard deviations, is the statistic.
Which of the two cars is wrong the disagreement cannot say; for the neighbours (suspect.py), a lie spreads it LIE times
as wide as the truth.
"""

from math import exp, isnan, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.consistency.attribution import FAULT_LOG_ODDS, accumulate
from headway.core.statistics import alarm_gate

SMOOTH_S = 0.5
SPREAD_FLOOR = (0.3, 0.1)
"""Disagreements in m and m/s that are never unusual, however good both sensors have been."""
LEADER_ACCEL_MPS2 = 1.0
"""What a leader's acceleration may have been since its last sample."""
OUTLIER = 3.0
"""Standard deviations beyond which a disagreement teaches no more."""
FAULT_SPREAD = 3.0
"""Standard deviations of the disagreement that a lie makes."""
SETTLE_S = 2.0

RANGING = np.dtype(
    [
        ("learning_time_s", "f8"),  # learnt from so far; 0: a fresh pair
        ("t_s", "f8"),
        ("offset", "f8", (2,)),  # m, m/s
        ("mean_disagreement", "f8", (2,)),  # disagreement averaged over SMOOTH_S; m, m/s
        ("mean_square", "f8", (2,)),  # mean square of it
        ("exceedance_time_s", "f8"),  # how long it has been beyond the gate
        ("tail", alarm_gate.TAIL),
        ("pair_fault", FAULT_LOG_ODDS),
    ],
    align=True,
)
"""One row; all zeros is a pair not seen yet."""


class RangingParams(NamedTuple):
    """How a pair's forward sensor is learnt and judged."""

    budget: alarm_gate.Budget
    memory_s: float = 120.0
    warming_s: float = 10.0
    max_gap_s: float = 1.2
    relearn_after_s: float = 60.0
    """Beyond the gate for so long, the pair begins anew: the sensor looks at another car, or sits elsewhere."""


@njit(cache=True)
def ranging_reset_leader(row: Any) -> None:
    """Another leader: other offsets, so begin anew."""
    row.learning_time_s = 0.0
    row.pair_fault.log_odds, row.pair_fault.t_s = 0.0, 0.0


@njit(cache=True)
def initialise(row: Any, t_s: float) -> None:
    """Forget the pair, save how high its statistic goes."""
    row.learning_time_s, row.t_s, row.exceedance_time_s = 0.0, t_s, 0.0
    row.offset[:] = 0.0
    row.mean_disagreement[:] = 0.0
    row.mean_square[:] = 0.0
    row.pair_fault.log_odds, row.pair_fault.t_s = 0.0, 0.0


@njit(cache=True)
def ranging_step(row: Any, z: Any, p: RangingParams, check: Any) -> None:
    """Take one READING into one RANGING row and write the CHECK; without a leader or a range it says `warming`."""
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
