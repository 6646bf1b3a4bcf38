"""Checks of the position: single steps, and displacement over one and over four seconds against the reported speed.

Only positions that differ from the one before are fixes, so that repeated positions and 1 Hz receivers are no gaps.
The way by speed and the way over ground may differ by noise, scale, age, and clock, each bounded in `limits`; what is
beyond is added up in time (Page's cumulative sum), and fades where the two agree. Over four seconds the way over ground
is that of two chords, which no bend makes shorter than the road by more than the scale.
"""

from math import exp, hypot
from typing import Any

from numba import njit

from headway.core.plausibility.limits import Limits
from headway.core.plausibility.state import (
    EAST,
    FIX_SPACING_S,
    FIXES,
    NORTH,
    ODD_READING,
    POSITION_CHANGE,
    POSITION_FROZEN,
    SPEED,
    WAY,
)
from headway.core.types.records import Sensor

_LOCATION, _SPEED = int(Sensor.LOCATION), int(Sensor.SPEED)
_SHORT_S, _LONG_S = 0.95, 3.8
_SHORT_MIN_S, _LONG_MIN_S = 0.6, 3.0
_STEP_MOST_S = 1.2  # what one fix adds to a cumulative sum lasts no longer
_SUM_MOST_MS = 3.0
_REPEATED = 8.0  # equal speeds in a row that no dithering sensor sends
_RETURN_M = 3.0
_LATE_FADE_S = 5.0
_MOVING_MPS = 0.5  # a receiver at rest holds its position for as long as it likes


@njit(cache=True, error_model="numpy")
def first_fix(row: Any, v_mps: float) -> None:
    """Begin the ring of fixes at the present position."""
    row.newest, row.fix_count = -1, 0
    _keep_fix(row, row.t_s, v_mps)
    row.fix_t_s, row.fix_way_m = row.t_s, row.way_m


@njit(cache=True, error_model="numpy")
def observe_position(
    row: Any, dt_s: float, east_m: float, north_m: float, v_mps: float, p: Limits, accuracy: float
) -> int:
    """Take the step of the position to this message, with `row.way_m` of it; return what it shows (Observation flags).

    `accuracy` is the room in metres that the declared accuracy makes.
    """
    t_s = row.t_s + dt_s
    row.interval_s = dt_s if row.interval_s == 0.0 else min(1.01 * row.interval_s, dt_s)
    row.late_s *= exp(-dt_s / _LATE_FADE_S)
    if east_m == 0.0 and north_m == 0.0:
        if v_mps > _MOVING_MPS:
            row.held_s = max(row.held_s, min(t_s - row.fix_t_s, 1.0))
        patience_s = p.frozen_first_s if row.fix_count <= 1 else p.frozen_s
        frozen = t_s - row.fix_t_s > patience_s and row.way_m - row.fix_way_m > p.frozen_m
        return POSITION_FROZEN if frozen else 0
    since_s = t_s - row.fix_t_s
    # Where positions are held, a new one may come with the next message, or with one that was lost.
    row.late_s = max(row.late_s, min(dt_s, row.held_s - 1.3 * row.interval_s))
    observed = _observe_step(row, t_s, since_s, east_m, north_m, v_mps, p, accuracy)
    # The speed between two messages is not known: 4 m/s2 either way, half of the time each.
    room_m = accuracy + dt_s * dt_s + max(v_mps, row.ground_mps) * row.late_s
    weight_s = min(since_s, _STEP_MOST_S)
    _observe_mismatch(row, t_s, weight_s, v_mps, p, room_m)
    row.fix_t_s, row.fix_way_m = t_s, row.way_m
    if t_s - row.fix_s[row.newest] >= FIX_SPACING_S - 0.06:
        _keep_fix(row, t_s, v_mps)
    return observed


@njit(cache=True, error_model="numpy")
def _observe_mismatch(row: Any, t_s: float, weight_s: float, v_mps: float, p: Limits, room_m: float) -> None:
    """Compare displacement and speed over both spans, and add up for `weight_s` what is beyond their limits."""
    short = _fix_before(row, t_s - _SHORT_S)
    short_s = t_s - row.fix_s[short]
    if short_s > _SHORT_MIN_S:
        ground_m = _distance_m(row, short)
        excess_m = _excess_m(row, short, ground_m, v_mps, p.second_m + room_m, p)
        row.short_ms = min(max(row.short_ms + weight_s * excess_m / max(short_s, 1.0), 0.0), _SUM_MOST_MS)
        row.before_mps = row.fixes[short, SPEED]
        row.ground_mps = min(ground_m / short_s, p.speed_mps)
        share = row.ground_mps / max(ground_m, 1e-9)
        row.ground[0] = share * (row.east_m - row.fixes[short, EAST])
        row.ground[1] = share * (row.north_m - row.fixes[short, NORTH])
    long = _fix_before(row, t_s - _LONG_S)
    long_s = t_s - row.fix_s[long]
    if long_s > _LONG_MIN_S:
        middle = _fix_before(row, t_s - 0.5 * long_s)
        ground_m = _distance_m(row, middle) + hypot(
            row.fixes[middle, EAST] - row.fixes[long, EAST], row.fixes[middle, NORTH] - row.fixes[long, NORTH]
        )
        excess_m = _excess_m(row, long, ground_m, v_mps, p.long_m + room_m, p)
        row.long_ms = min(max(row.long_ms + 0.5 * weight_s * excess_m, 0.0), _SUM_MOST_MS)


@njit(cache=True, error_model="numpy")
def _observe_step(
    row: Any, t_s: float, since_s: float, east_m: float, north_m: float, v_mps: float, p: Limits, accuracy: float
) -> int:
    """Compare one step of the position, `since_s` after the last, with where the car may have gone from there.

    Until its velocity over ground is known that is anywhere within reach of the highest speed. A step that no car
    makes counts as the way that the car would have made, so that one cause is observed once.
    """
    known = row.ground_mps > 0.0
    fastest = max(v_mps, row.v_mps, row.ground_mps) if known else p.speed_mps
    off_east_m, off_north_m = east_m - row.ground[0] * since_s, north_m - row.ground[1] * since_s
    unsure_s = p.clock_s + row.late_s + (p.scale if known else 1.0) * since_s
    excess_m = (
        hypot(off_east_m, off_north_m)
        - p.position_slack_m
        - accuracy
        - fastest * unsure_s
        - 0.5 * p.accel_mps2 * since_s * since_s
    )
    if excess_m <= 0.0:
        row.east_m += east_m
        row.north_m += north_m
        return 0
    place_east_m, place_north_m = row.east_m + row.jumped_m[0], row.north_m + row.jumped_m[1]
    row.east_m += east_m - off_east_m
    row.north_m += north_m - off_north_m
    row.jumped_m[0] += off_east_m
    row.jumped_m[1] += off_north_m
    row.position_score = min(row.position_score + excess_m / p.position_excess_m, 2.0)
    row.jumps[0] += 1.0
    back_m = hypot(place_east_m + east_m - row.other_m[0], place_north_m + north_m - row.other_m[1])
    away_s = t_s - row.other_s
    returned = away_s < 5.0 and back_m < _RETURN_M + accuracy + 1.2 * fastest * away_s
    row.returns = min(max(row.returns + (1.0 if returned else -1.0), 0.0), 6.0)
    if returned and row.jumps[0] < ODD_READING:
        row.position_score = 0.0
    row.other_s = row.t_s
    row.other_m[0], row.other_m[1] = place_east_m, place_north_m
    return POSITION_CHANGE


@njit(cache=True, error_model="numpy")
def _excess_m(row: Any, fix: int, ground_m: float, v_mps: float, slack_m: float, p: Limits) -> float:
    """Return by how much the way over ground since a fix differs from that by speed, beyond all limits."""
    way_m = row.way_m - row.fixes[fix, WAY]
    slack_m += p.scale * min(ground_m, way_m) + p.age_s * abs(v_mps - row.fixes[fix, SPEED])
    return float(abs(ground_m - way_m) - slack_m)


@njit(cache=True, error_model="numpy")
def mismatched_sensor(row: Any, v_mps: float) -> int:
    """Return which sensor contradicts the other: the one that changed, and the speed where neither did.

    A wrong speed may stay wrong by the same amount for ever. A position that did would leave the road.
    """
    old = _fix_before(row, -1.0)
    span_s = row.fix_t_s - row.fix_s[old]
    if row.jumps[0] > row.jumps[1]:
        return _LOCATION
    if row.fix_count < FIXES or span_s < _LONG_S or row.repeats >= _REPEATED or v_mps == 0.0 or row.jumps[1] > 0.0:
        return _SPEED
    later = _fix_before(row, row.fix_s[old] + 1.0)
    was_mps = hypot(
        row.fixes[later, EAST] - row.fixes[old, EAST], row.fixes[later, NORTH] - row.fixes[old, NORTH]
    ) / max(row.fix_s[later] - row.fix_s[old], 0.1)
    agreed = abs(was_mps - row.fixes[old, SPEED]) < 1.5
    over_ground, by_speed = abs(row.ground_mps - was_mps), abs(v_mps - row.fixes[old, SPEED])
    return _LOCATION if agreed and over_ground > by_speed + 1.0 else _SPEED


@njit(cache=True, error_model="numpy")
def _keep_fix(row: Any, t_s: float, v_mps: float) -> None:
    row.newest = (row.newest + 1) & (FIXES - 1)
    row.fix_count = min(row.fix_count + 1, FIXES)
    row.fix_s[row.newest] = t_s
    fix = row.fixes[row.newest]
    fix[EAST], fix[NORTH], fix[WAY], fix[SPEED] = row.east_m, row.north_m, row.way_m, v_mps


@njit(cache=True, error_model="numpy")
def _fix_before(row: Any, t_s: float) -> int:
    """Return the newest fix no later than `t_s`, or the oldest kept."""
    at = row.newest
    for k in range(row.fix_count):
        at = (row.newest - k) & (FIXES - 1)
        if row.fix_s[at] <= t_s:
            break
    return int(at)


@njit(cache=True, error_model="numpy")
def _distance_m(row: Any, fix: int) -> float:
    """Return how far the present position is from a fix."""
    return hypot(row.east_m - row.fixes[fix, EAST], row.north_m - row.fixes[fix, NORTH])
