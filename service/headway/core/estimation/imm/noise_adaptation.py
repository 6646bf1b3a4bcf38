"""How noisy a vehicle's sensors are, how jerky its driver, how far its location and its speed go apart.

All is learnt from the innovations of readings that are taken for healthy, one number each on a logarithm, in steps that
are large at first. The share of innovations beyond a quartile tells whether a level is right, and an outlier weighs no
more than any other reading (Robbins-Monro on a quantile). The sensor's noise and the motion's own (jerk for the speed,
walk for the location) both widen an innovation; signs tell them apart: with too little of the motion's the filter lags
and innovations keep their sign, with too much they alternate (Mehra 1970, doi:10.1109/TAC.1970.1099422). A location
that keeps running ahead of its prediction slips beside the speed, or the speed is older than it: the one whatever the
car does, the other with its acceleration (recursive least squares).
"""

from math import copysign, exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.kinematics import LOCATION, SPEED

QUARTILE = 1.1503493803760079
"""A standard normal goes beyond it, to either side, in one case of four."""

OUTLYING = 3.0
"""Standard deviations beyond which an innovation says no more than one of so many."""

NOISE_AS_WALK_HZ = 20.0
"""Noise of variance r makes displacements at 10 Hz as uncertain as a walk of density 20 r: r at either end of each."""

LEVELS = np.dtype(
    [
        ("r", "f8", (2,)),  # variance of location and speed readings
        ("q", "f8"),  # density of the jerk, m^2/s^5
        ("slip", "f8"),  # how much faster the location moves than the reported speed says, m/s
        ("lag_s", "f8"),  # how old a reported speed is, beside the location
        ("unsure", "f8", (3,)),  # (co)variances ss, sl, ll of slip and lag; 1: of what one location shows of both
        ("walk", "f8"),  # density of what location and speed differ by, m^2/s
        ("learnt", "f8"),  # readings so far
        ("nu", "f8", (2,)),  # innovations one reading ago; 0: none
    ],
    align=True,
)


class Levels(NamedTuple):
    """Where the learning starts, how fast it is, and where it ends; std in m and m/s, densities as in LEVELS."""

    x_std_m: float
    v_std_mps: float
    jerk: float
    walk: float
    std_least: float
    x_std_most_m: float
    v_std_most_mps: float
    jerk_least: float
    jerk_most: float
    walk_least: float
    walk_most: float
    wander_least: float
    """Walk and noise of a location together, as a walk, are never less: a location without noise of its own has been
    smoothed by its receiver, and wanders, in a way that is correlated over seconds."""
    slowest: float
    """Step on a logarithm per reading once all is settled;"""
    settling: float
    """before, it is 1 / (1 + settling * readings)."""
    sign_step: float
    """Part of a first step, on walk against location noise, that signs decide; it settles likewise,"""
    sign_slowest: float
    """to this step."""
    sign_share: float
    """Part of a step, on jerk against speed noise, that signs decide."""
    walk_seen: float
    """Walk per second, as a share of the variance of the location, below which signs cannot tell it from none;"""
    walk_fade: float
    """then it shrinks by this on the logarithm with each reading."""
    slip_early: float
    """Variance of slip,"""
    lag_early: float
    """and of lag before anything is heard, over that of what one location shows of them."""
    slip_gain: float
    """Part of what the location runs ahead by that goes into slip and lag with each reading once they are known."""
    slip_most_mps: float
    lag_most_s: float


@njit(cache=True)
def begin_levels(levels: Any, p: Levels) -> None:
    """Forget what was learnt."""
    levels.r[LOCATION], levels.r[SPEED] = p.x_std_m**2, p.v_std_mps**2
    levels.q, levels.walk = p.jerk, p.walk
    levels.slip, levels.lag_s = 0.0, 0.0
    levels.unsure[0], levels.unsure[1], levels.unsure[2] = p.slip_early, 0.0, p.lag_early
    levels.learnt = 0.0
    interrupt(levels)


@njit(cache=True)
def step_size(levels: Any, p: Levels) -> float:
    """Return how far, on a logarithm, one reading may move a level."""
    return float(max(p.slowest, 1.0 / (1.0 + p.settling * levels.learnt)))


@njit(cache=True)
def interrupt(levels: Any) -> None:
    """Say that the next innovation does not follow on the last one."""
    levels.nu[LOCATION], levels.nu[SPEED] = 0.0, 0.0


@njit(cache=True)
def errors(levels: Any, sensor: int, nu: float, s: float, sign_step: float) -> tuple[float, float]:
    """Return what an innovation says of both levels behind it together, and of the motion's against the sensor's."""
    wide = (1.0 if abs(nu) > QUARTILE * sqrt(s) else 0.0) - 0.25
    product = levels.nu[sensor] * nu
    levels.nu[sensor] = nu
    return wide, copysign(sign_step, product) if product != 0.0 else 0.0


@njit(cache=True)
def learn_levels(levels: Any, dt_s: float, a_mps2: float, nu: Any, cov: Any, unforeseen: float, p: Levels) -> None:
    """Take the innovation of a reading that is taken for healthy, with its variances.

    `unforeseen` is the share of what the driver does that the car ahead does not announce.
    """
    step = step_size(levels, p)
    turn = max(p.sign_slowest, p.sign_step / (1.0 + p.settling * levels.learnt)) / step
    levels.learnt += 1.0
    x_wide, x_lag = errors(levels, LOCATION, nu[LOCATION], cov[0], turn)
    v_wide, v_lag = errors(levels, SPEED, nu[SPEED], cov[2], p.sign_share)
    levels.r[LOCATION] = bounded(levels.r[LOCATION] * exp(step * (x_wide - x_lag)), p.std_least**2, p.x_std_most_m**2)
    levels.r[SPEED] = bounded(levels.r[SPEED] * exp(step * (v_wide - v_lag)), p.std_least**2, p.v_std_most_mps**2)
    levels.q = bounded(levels.q * exp(step * (v_wide + v_lag)), unforeseen * p.jerk_least, p.jerk_most)
    ahead_mps = (1.0 - levels.r[LOCATION] / cov[0]) * tamed(nu[LOCATION], cov[0]) / dt_s
    learn_slip(levels, ahead_mps, a_mps2, p)
    fade = p.walk_fade if levels.walk < p.walk_seen * levels.r[LOCATION] else 0.0
    walk_least = max(p.walk_least, p.wander_least - NOISE_AS_WALK_HZ * levels.r[LOCATION])
    levels.walk = bounded(levels.walk * exp(step * (x_wide + x_lag) - fade), walk_least, p.walk_most)


@njit(cache=True)
def learn_slip(levels: Any, ahead_mps: float, a_mps2: float, p: Levels) -> None:
    """Take a location that ran ahead of its prediction by `ahead_mps`: slip + lag a, and noise of unit variance."""
    c = levels.unsure
    slip, lag = c[0] + c[1] * a_mps2, c[1] + c[2] * a_mps2
    share = 1.0 / (1.0 + slip + lag * a_mps2)
    shift(levels, share * slip * ahead_mps, p)
    levels.lag_s = bounded(levels.lag_s + share * lag * ahead_mps, -p.lag_most_s, p.lag_most_s)
    c[0] += p.slip_gain**2 - share * slip * slip
    c[1] -= share * slip * lag
    c[2] += p.slip_gain**2 - share * lag * lag


@njit(cache=True)
def shift(levels: Any, ahead_mps: float, p: Levels) -> None:
    """Take locations to run ahead of the speed by `ahead_mps` more."""
    levels.slip = bounded(levels.slip + ahead_mps, -p.slip_most_mps, p.slip_most_mps)


@njit(cache=True)
def tamed(nu: float, s: float) -> float:
    """Return an innovation of variance `s`, and of an outlying one no more than counts."""
    most = OUTLYING * sqrt(s)
    return bounded(nu, -most, most)


@njit(cache=True)
def bounded(value: float, least: float, most: float) -> float:
    """Return `value`, or the nearer of the two limits."""
    return min(max(value, least), most)
