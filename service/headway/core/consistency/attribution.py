"""Who lies, the leader or the follower? A pair alone half knows; its neighbours decide.

A liar spoils two pairs: the one in which it follows and the one in which it leads. An honest car in dispute with a liar
is on good terms with its other neighbour: the car behind answers what it does, and it answers the car ahead. Each pair
has a doubt, the log odds of late that one of its two cars does not tell the truth, and adds to it what every reading
is worth:

    L <- max(L exp(-dt / FADE_S) + weight LLR, LOG_ODDS_MIN)      LLR = ln p(reading | fault) - ln p(reading | healthy)

A pair in dispute asks the pair behind its follower and the pair ahead, in which its leader follows:

    log odds (follower : leader) = own_unusual + doubt behind - (doubt ahead, or due_unusual where nobody is ahead)

The last two are what a pair tells by itself: by how much the follower's reported motion, and the leader's as seen in
what it should have caused, went beyond that driver's usual one. A neighbour who is not there says nothing.
"""

from math import exp
from typing import Any

import numpy as np
from numba import njit

FADE_S = 5.0
"""Time constant of a doubt: a driver's answer takes a second or two, its test another two."""
LOG_ODDS_MIN = -2.0
"""The doubt goes no lower: that a pair has been in order says little of what follows."""
LOG_LIKELIHOOD_RATIO_MAX = 6.0
"""No single reading is worth more."""
SURPRISE_MAX = 12.0
"""Nor is what a pair tells by itself."""

FAULT_LOG_ODDS = np.dtype([("log_odds", "f8"), ("t_s", "f8")], align=True)
"""All zeros is a pair that was never judged."""


@njit(cache=True)
def decayed(log_odds: float, updated_s: float, t_s: float) -> float:
    """Return what is left at `t_s` of a statement made at `updated_s`."""
    return log_odds * exp(-max(t_s - updated_s, 0.0) / FADE_S)


@njit(cache=True)
def accumulate(pair_fault: Any, log_likelihood_ratio: float, weight: float, t_s: float) -> None:
    """Add what a reading is worth to a FAULT_LOG_ODDS row; `weight` is below 1 where readings overlap."""
    previous = decayed(pair_fault.log_odds, pair_fault.t_s, t_s)
    pair_fault.log_odds = max(
        previous + weight * min(max(log_likelihood_ratio, -LOG_LIKELIHOOD_RATIO_MAX), LOG_LIKELIHOOD_RATIO_MAX),
        LOG_ODDS_MIN,
    )
    pair_fault.t_s = t_s


@njit(cache=True)
def is_recent(pair_fault: Any, t_s: float) -> bool:
    """Whether the pair was judged within FADE_S."""
    return bool(t_s - pair_fault.t_s <= FADE_S)


@njit(cache=True)
def follower_log_odds(behind: Any, ahead: Any, follower_surprise: float, leader_surprise: float, t_s: float) -> float:
    """Return the log odds that the fault is the follower's, not the leader's; `behind`, `ahead`: FAULT_LOG_ODDS."""
    surprise, neighbours = follower_surprise - leader_surprise, 0.0
    if is_recent(ahead, t_s):
        surprise, neighbours = follower_surprise, -decayed(ahead.log_odds, ahead.t_s, t_s)
    if is_recent(behind, t_s):
        neighbours += decayed(behind.log_odds, behind.t_s, t_s)
    return float(neighbours + min(max(surprise, -SURPRISE_MAX), SURPRISE_MAX))
