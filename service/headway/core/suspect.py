"""Who lies, the leader or the follower? A pair alone half knows; its neighbours decide.

Every car has two witnesses: its own row, where it answers the car ahead, and the row of the car behind, which answers
it. A liar disturbs both; an honest car only the row that it shares with the liar. So in a dispute of size mu between
two cars, the row behind the follower and the leader's own row tell them apart: a statistic z there is N(mu, 1) if the
car in common lies and N(0, 1) if it does not, and the witness is worth the log likelihood ratio mu z - mu^2 / 2. A
calm witness speaks against a lie as a disturbed one speaks for it; one who is not there says nothing.

    log odds (follower : leader) = lean + (mu behind - mu^2 / 2) - (mu ahead - mu^2 / 2)

`lean` is what the two cars tell by themselves: whose reported motion was unlike that driver's usual one.
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
def held(statement: float, said_s: float, t_s: float) -> float:
    """Return what is left at `t_s` of a statement made at `said_s`."""
    return statement * exp(-max(t_s - said_s, 0.0) / HOLD_S)


@njit(cache=True)
def bear_witness(follower: Any, leader: Any, statistic: float, t_s: float) -> None:
    """Note a pair's newest statistic with both its cars (WITNESS rows)."""
    follower.ahead = max(statistic, held(follower.ahead, follower.ahead_t_s, t_s))
    follower.ahead_t_s = t_s
    leader.behind = max(statistic, held(leader.behind, leader.behind_t_s, t_s))
    leader.behind_t_s = t_s


@njit(cache=True)
def worth(statement: float, said_s: float, t_s: float, mu: float) -> float:
    """Return the log likelihood ratio of a witness heard within HOLD_S; 0 for one who is not there."""
    if t_s - said_s > HOLD_S:
        return 0.0
    return mu * (min(held(statement, said_s, t_s), CAP) - 0.5 * mu)


@njit(cache=True)
def follower_log_odds(follower: Any, leader: Any, lean: float, t_s: float) -> float:
    """Return the log odds that the follower lies rather than the leader (WITNESS rows of a pair that has testified)."""
    mu = min(held(follower.ahead, follower.ahead_t_s, t_s), CAP)
    behind = worth(follower.behind, follower.behind_t_s, t_s, mu)
    ahead = worth(leader.ahead, leader.ahead_t_s, t_s, mu)
    most = 0.5 * CAP**2
    return float(min(max(lean, -most), most) + behind - ahead)
