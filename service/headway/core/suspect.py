"""Who lies, the leader or the follower? A pair alone half knows; its neighbours decide.

Every car has two witnesses: its own row, where it answers the car ahead, and the row of the car behind, which answers
it. A car that lies disturbs both; an honest one disturbs the row that it shares with the liar only. So for a pair

    log odds (follower : leader) = lean + 1/2 (behind^2 - ahead^2)

with `behind` the statistic of the row behind the follower, `ahead` that of the leader's own row, both in standard
deviations, the largest of the last few seconds since drivers answer late. `lean` is what the two cars tell by
themselves: whose reported motion was unlike that driver's usual one.
"""

from math import exp
from typing import Any

import numpy as np
from numba import njit

HOLD_S = 5.0
"""Time constant at which a statement fades: a driver's answer takes a second or two, its test another two."""
CAP = 6.0
"""Standard deviations beyond which a statement weighs no more."""

WITNESS = np.dtype(
    [
        ("ahead", "f8"),  # statistic of this car's own row
        ("ahead_t_s", "f8"),
        ("behind", "f8"),  # statistic of the row behind it
        ("behind_t_s", "f8"),
    ],
    align=True,
)
"""One row per car and test; all zeros is a car nobody has spoken of."""


@njit(cache=True)
def faded(statement: float, said_s: float, t_s: float) -> float:
    """Return what is left at `t_s` of a statement made at `said_s`."""
    return statement * exp(-max(t_s - said_s, 0.0) / HOLD_S)


@njit(cache=True)
def testify(follower: Any, leader: Any, statistic: float, t_s: float) -> None:
    """Note the newest statistic of a pair with both its cars (WITNESS rows)."""
    follower.ahead = max(statistic, faded(follower.ahead, follower.ahead_t_s, t_s))
    follower.ahead_t_s = t_s
    leader.behind = max(statistic, faded(leader.behind, leader.behind_t_s, t_s))
    leader.behind_t_s = t_s


@njit(cache=True)
def follower_log_odds(follower: Any, leader: Any, t_s: float) -> float:
    """Return what the neighbours add to the log odds that the follower lies rather than the leader.

    With mu the size of the dispute, a disturbed witness reads N(mu / 2, 1)... 
    """
    return 0.0
