"""Checks of the declared heading: against the course over ground, and against what a car can turn."""

from math import acos, hypot
from typing import Any

from numba import njit

from headway.core.plausibility.limits import Limits
from headway.core.plausibility.state import EAST, FIXES, HEADING, NORTH

_WINDOW_S = 0.95
_DISTANCE_MIN_M = 5.0
_TURNING_MPS = 5.0  # below it a heading may be a course, which noise turns
_SCORE_PER_S = 2.5


@njit(cache=True, error_model="numpy")
def observe_heading(row: Any, dt_s: float, east: float, north: float, v_mps: float, p: Limits) -> int:
    """Take the declared heading, a unit vector or (0, 0) for none, before `row` takes this message's position.

    Return HEADING where it contradicts the course, or turns faster than a car.
    """
    if east == 0.0 and north == 0.0:
        return 0
    observed = 0
    known = row.heading_east != 0.0 or row.heading_north != 0.0
    if known and v_mps > _TURNING_MPS and row.v_mps > _TURNING_MPS:
        turned = acos(min(max(east * row.heading_east + north * row.heading_north, -1.0), 1.0))
        if turned > p.turn_slack_rad + p.turn_mps2 / v_mps * dt_s:
            row.heading_score = min(row.heading_score + 0.6, 2.0)
            observed = HEADING
    if v_mps < p.course_mps or row.ground_mps < p.course_mps:
        return observed
    at = row.newest
    for k in range(row.fix_count):
        at = (row.newest - k) & (FIXES - 1)
        if row.t_s - row.fix_s[at] >= _WINDOW_S:
            break
    over_east, over_north = row.east_m - row.fixes[at, EAST], row.north_m - row.fixes[at, NORTH]
    distance_m = hypot(over_east, over_north)
    if distance_m > _DISTANCE_MIN_M and over_east * east + over_north * north < p.course_cos * distance_m:
        row.heading_score = min(row.heading_score + _SCORE_PER_S * min(dt_s, 0.5), 2.0)
        observed = HEADING
    return observed
