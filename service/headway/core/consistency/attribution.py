"""Attribute an inconsistency of a pair to its follower or its leader, with the help of the neighbouring pairs.

A faulty vehicle is inconsistent with both of its neighbours: with the vehicle it follows and with the vehicle behind. A
healthy vehicle is inconsistent with the faulty neighbour only. Each pair keeps the log odds L that one of its two
vehicles is faulty, and adds the log-likelihood ratio (LLR) of each reading:

    L <- max(L exp(-dt / FADE_S) + weight LLR, LOG_ODDS_MIN)      LLR = ln p(reading | fault) - ln p(reading | healthy)

For an inconsistent pair, the pair behind its follower and the pair ahead of its leader give

    log odds (follower : leader) = follower_surprise + L behind - (L ahead, or leader_surprise without a vehicle ahead)

A motion surprise is the evidence of the pair itself: how far the reported motion of the follower exceeds the usual
motion of its driver, and how far the motion of the leader does, as seen in the response that it should cause. A pair
that does not exist contributes nothing.
"""

from math import exp
from typing import Any

import numpy as np
from numba import njit

FADE_S = 5.0
"""Time constant of the log odds: a response takes one to two seconds, and its test another two."""
LOG_ODDS_MIN = -2.0
"""Lower bound of the log odds: a consistent past says little about the present."""
LOG_LIKELIHOOD_RATIO_MAX = 6.0
"""Bound of the log-likelihood ratio of one reading."""
WITNESS_LOG_ODDS = 2.0
"""Log odds of a neighbouring pair from which it is a witness: .88."""
SUPPORT_LOG_ODDS = -0.25
"""Log odds of a pair below which each of its vehicles supports the other."""
SURPRISE_MAX = 12.0
"""Bound of the motion surprise of a pair."""

FAULT_LOG_ODDS = np.dtype([("log_odds", "f8"), ("t_s", "f8")], align=True)
"""Log odds of a fault in a pair; all zeros is a pair without a reading."""


@njit(cache=True, error_model="numpy")
def decayed(log_odds: float, updated_s: float, t_s: float) -> float:
    """Return at `t_s` the log odds that were updated at `updated_s`."""
    return log_odds * exp(-max(t_s - updated_s, 0.0) / FADE_S)


@njit(cache=True, error_model="numpy")
def accumulate(pair_fault: Any, log_likelihood_ratio: float, weight: float, t_s: float) -> None:
    """Add the log-likelihood ratio of a reading to FAULT_LOG_ODDS; `weight` is below 1 where readings overlap."""
    previous = decayed(pair_fault.log_odds, pair_fault.t_s, t_s)
    pair_fault.log_odds = max(
        previous + weight * min(max(log_likelihood_ratio, -LOG_LIKELIHOOD_RATIO_MAX), LOG_LIKELIHOOD_RATIO_MAX),
        LOG_ODDS_MIN,
    )
    pair_fault.t_s = t_s


@njit(cache=True, error_model="numpy")
def is_recent(pair_fault: Any, t_s: float) -> bool:
    """Whether the pair had a reading within FADE_S."""
    return bool(t_s - pair_fault.t_s <= FADE_S)


@njit(cache=True, error_model="numpy")
def is_inconsistent(pair_fault: Any, t_s: float) -> bool:
    """Whether the pair had a reading of late, and is inconsistent."""
    return is_recent(pair_fault, t_s) and decayed(pair_fault.log_odds, pair_fault.t_s, t_s) > WITNESS_LOG_ODDS


@njit(cache=True, error_model="numpy")
def is_consistent(pair_fault: Any, t_s: float) -> bool:
    """Whether the pair had a reading of late, and is consistent."""
    return is_recent(pair_fault, t_s) and decayed(pair_fault.log_odds, pair_fault.t_s, t_s) < SUPPORT_LOG_ODDS


@njit(cache=True, error_model="numpy")
def is_witnessed(behind: Any, ahead: Any, behind_both: Any, ahead_of_both: Any, t_s: float) -> bool:
    """Whether the pair `behind`, or that `ahead`, contradicts the suspect too, and another pair supports it.

    A driver may brake, or not, for reasons that the leader does not show. Then the vehicle behind responds to it. A
    vehicle that does not exist contradicts all others. So a witness counts that is consistent with a third vehicle: in
    the next pair on (`behind_both`, `ahead_of_both`), or across the pair that is judged.
    """
    by_behind = is_inconsistent(behind, t_s) and (is_consistent(behind_both, t_s) or is_consistent(ahead, t_s))
    by_ahead = is_inconsistent(ahead, t_s) and (is_consistent(ahead_of_both, t_s) or is_consistent(behind, t_s))
    return by_behind or by_ahead


@njit(cache=True, error_model="numpy")
def follower_log_odds(behind: Any, ahead: Any, follower_surprise: float, leader_surprise: float, t_s: float) -> float:
    """Return the log odds that the fault is the follower's, not the leader's; `behind`, `ahead`: FAULT_LOG_ODDS."""
    surprise, neighbours = follower_surprise - leader_surprise, 0.0
    if is_recent(ahead, t_s):
        surprise, neighbours = follower_surprise, -decayed(ahead.log_odds, ahead.t_s, t_s)
    if is_recent(behind, t_s):
        neighbours += decayed(behind.log_odds, behind.t_s, t_s)
    return float(neighbours + min(max(surprise, -SURPRISE_MAX), SURPRISE_MAX))
