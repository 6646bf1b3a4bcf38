"""Who lies, the leader or the follower? A pair alone half knows; its neighbours decide.

A liar spoils two pairs: the one in which it follows and the one in which it leads. An honest car in dispute with a liar
is on good terms with its other neighbour: the car behind answers what it does, and it answers the car ahead. Each pair
has a doubt, the log odds of late that one of its two cars does not tell the truth, and adds to it what every reading
is worth:

    doubt <- max(doubt exp(-dt / FADE_S) + share worth, -CALM)      worth = ln p(read | a lie) - ln p(read | the truth)

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
CALM = 2.0
"""The doubt goes no lower: that a pair has been in order says little of what follows."""
MOST = 6.0
"""No single reading is worth more."""
ALONE = 12.0
"""Nor is what a pair tells by itself."""

DOUBT = np.dtype([("log_odds", "f8"), ("t_s", "f8")], align=True)
"""All zeros is a pair that was never judged."""


@njit(cache=True)
def held(log_odds: float, said_s: float, t_s: float) -> float:
    """Return what is left at `t_s` of a statement made at `said_s`."""
    return log_odds * exp(-max(t_s - said_s, 0.0) / FADE_S)


@njit(cache=True)
def weigh(doubt: Any, worth: float, share: float, t_s: float) -> None:
    """Add what a reading is worth to a DOUBT; `share` is below 1 where readings overlap."""
    left = held(doubt.log_odds, doubt.t_s, t_s)
    doubt.log_odds = max(left + share * min(max(worth, -MOST), MOST), -CALM)
    doubt.t_s = t_s


@njit(cache=True)
def is_heard(doubt: Any, t_s: float) -> bool:
    """Whether the pair was judged within FADE_S."""
    return bool(t_s - doubt.t_s <= FADE_S)


@njit(cache=True)
def follower_log_odds(behind: Any, ahead: Any, own_unusual: float, due_unusual: float, t_s: float) -> float:
    """Return the log odds that the follower lies rather than the leader; `behind` and `ahead` are DOUBT."""
    unusual, told = own_unusual - due_unusual, 0.0
    if is_heard(ahead, t_s):
        unusual, told = own_unusual, -held(ahead.log_odds, ahead.t_s, t_s)
    if is_heard(behind, t_s):
        told += held(behind.log_odds, behind.t_s, t_s)
    return float(told + min(max(unusual, -ALONE), ALONE))
