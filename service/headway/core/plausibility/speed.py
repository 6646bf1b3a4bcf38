"""Checks of the reported speed by itself: its value, its change, and whether it still moves at all.

A speed that is held between the fixes of a slow receiver may change by as much as since it last changed.

**Frozen speed.** A sensor that dithers by more than its resolution does not repeat a value for long. With noise of rho
resolutions the likeliest value is repeated with probability erf(1 / (2 sqrt(2) rho)), and a run of n repetitions has
that probability to the power of n. rho comes from second differences of a steady speed.
"""

from math import erf, log, sqrt
from typing import Any

from numba import njit

from headway.core.plausibility.limits import Limits
from headway.core.plausibility.state import JERK, ODD_READING, SPEED_CHANGE, SPEED_FROZEN, SPEED_VALUE

_RUN_LOG_PROBABILITY = -18.0  # ln of how often a run of equal speeds may be that long by chance
_DITHERS_MIN = 50.0
_DITHERS_MEMORY = 200.0
_DITHER_SHARE_MIN = 0.02  # rho = 0.25 has 0.008, rho = 0.35 has 0.024, rho = 0.5 has 0.08
_ROUNDING = 1.0 / 12.0  # variance of rounding, in resolutions^2
_MOVING_MPS = 2.0
_HELD_MOST_S = 1.0  # a speed is brought up to date once a second at least
_STEADY_STEPS = 3.0  # more resolutions within a second are a real change of speed
_STEADY_S = 0.35  # longer steps hold real changes of speed


@njit(cache=True, error_model="numpy")
def observe_speed(row: Any, dt_s: float, v_mps: float, p: Limits) -> int:
    """Take the speed of a message, `dt_s` after the last one; return what it shows by itself (Observation flags)."""
    observed = SPEED_VALUE if v_mps > p.speed_mps else 0
    since_s = row.t_s + dt_s - row.speed_since_s
    held_s = max(dt_s, min(since_s, 1.1 * row.speed_interval_s))
    excess_mps = abs(v_mps - row.v_mps) - p.accel_mps2 * held_s - p.speed_slack_mps
    if excess_mps > 0.0:
        row.speed_score = min(row.speed_score + excess_mps / p.speed_excess_mps, 2.0)
        observed |= SPEED_CHANGE
        back_mps = 2.0 * (p.accel_mps2 * dt_s + p.speed_slack_mps)
        if 0.3 < row.jumps[1] < ODD_READING - 1.0 and abs(v_mps - row.odd_from_mps) < back_mps:
            row.speed_score = 0.0
        row.jumps[1] += 1.0
        row.odd_from_mps = row.v_mps
    if v_mps != row.v_mps and _change_speed(row, v_mps - row.v_mps, since_s, p):
        observed |= JERK
    if v_mps > _MOVING_MPS and row.v_mps > _MOVING_MPS and dt_s < _STEADY_S:
        if is_frozen(row, v_mps):
            observed |= SPEED_FROZEN
    elif v_mps != row.v_mps:
        row.repeats = 0.0
    if v_mps != row.v_mps:
        row.speed_interval_s = min(1.01 * row.speed_interval_s, since_s, _HELD_MOST_S)
        row.speed_since_s = row.t_s + dt_s
    return observed


@njit(cache=True, error_model="numpy")
def _change_speed(row: Any, change_mps: float, since_s: float, p: Limits) -> bool:
    """Compare a change of the speed within `since_s` with the one before it; return whether the jerk is too large.

    Each of the two alone is within the limits of a change, or it is none of this check.
    """
    before_mps, before_s = row.speed_change_mps, row.speed_change_s
    row.speed_change_mps, row.speed_change_s = change_mps, since_s
    least_s = min(since_s, before_s)
    if before_s == 0.0 or max(since_s, before_s) > _STEADY_S:
        return False
    if max(abs(change_mps) / since_s, abs(before_mps) / before_s) > p.accel_mps2 + p.speed_slack_mps / least_s:
        return False
    jerk_mps2 = abs(change_mps / since_s - before_mps / before_s) - p.jerk_mps3 * 0.5 * (since_s + before_s)
    excess_mps = least_s * (jerk_mps2 - p.speed_slack_mps * (1.0 / since_s + 1.0 / before_s))
    if excess_mps <= 0.0:
        return False
    row.jerk_score = min(row.jerk_score + excess_mps / p.speed_excess_mps, 2.0)
    row.jumps[1] += 0.5
    return True


@njit(cache=True, error_model="numpy")
def is_frozen(row: Any, v_mps: float) -> bool:
    """Learn how the speed dithers while it does; return whether it has stood still for too long to be alive."""
    step = v_mps - row.v_mps
    if step == 0.0:
        row.repeats += 1.0
    else:
        row.repeats = 0.0
        size = abs(step)
        if row.resolution == 0.0 or size < row.resolution - 1e-6:
            row.resolution = size
            row.dithers = row.dither = row.roughness = 0.0
    steady = abs(v_mps - row.before_mps) <= _STEADY_STEPS * row.resolution
    if steady and row.resolution > 0.0 and row.repeats < 10.0:
        second = (step - row.speed_step) / row.resolution
        row.dithers = min(row.dithers + 1.0, _DITHERS_MEMORY)
        row.dither += ((1.0 if abs(second) > 2.5 else 0.0) - row.dither) / row.dithers
        row.roughness += (min(second * second, 24.0) - row.roughness) / row.dithers
    row.speed_step = step
    if row.dithers < _DITHERS_MIN or row.dither < _DITHER_SHARE_MIN:
        return False
    rho_squared = row.roughness / 6.0 - _ROUNDING
    if rho_squared <= 0.0:
        return False
    return bool(row.repeats * log(erf(1.0 / (2.0 * sqrt(2.0 * rho_squared)))) < _RUN_LOG_PROBABILITY)
