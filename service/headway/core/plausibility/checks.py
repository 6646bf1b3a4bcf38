"""All plausibility checks of one message: what is observed, which sensor it concerns, and how sure it is.

The checks hold from the first message on. They look at what was received, never at what the filter made of it, and
learn nothing that could widen a limit. An observation stands until the evidence for it has faded.
"""

from math import cos, exp, isfinite, radians, sin
from typing import Any

from numba import njit

from headway.core.plausibility.displacement import first_fix, mismatched_sensor, observe_position
from headway.core.plausibility.heading import observe_heading
from headway.core.plausibility.limits import Limits
from headway.core.plausibility.speed import observe_speed
from headway.core.plausibility.state import (
    ACCELERATION,
    APPEARANCE,
    CONTRADICTION,
    HEADING,
    IDENTITY,
    INTERVAL,
    JERK,
    ODD_READING,
    OVERLAP,
    POSITION_CHANGE,
    POSITION_FROZEN,
    POSITION_SPEED,
    SPEED_CHANGE,
    SPEED_FROZEN,
    SPEED_VALUE,
)
from headway.core.runtime.prefetch import prefetch_row
from headway.core.types.records import Kind, Sensor

_LOCATION, _SPEED, _BOTH = int(Sensor.LOCATION), int(Sensor.SPEED), int(Sensor.BOTH)
_LINK, _HEADING = int(Sensor.LINK), int(Sensor.HEADING)
_UNKNOWN, _SHORT, _NOISE, _BIAS = int(Kind.UNKNOWN), int(Kind.SHORT), int(Kind.NOISE), int(Kind.BIAS)

ON, OFF = 1.0, 0.2
"""Scores at which an observation is made, and at which it is over."""

_CONFIRM_S = 1.6  # after so long both sensors have shown whether they agree upon a change of motion
_RELEASE_S = 5.0  # of plausible driving that end an impossible change of motion
_RETURNED_MPS = 3.0
_ONSET_S = 0.4  # before, nothing is known of the kind
_IDENTITY_RETURNS = 4.0
_CONTRADICTION_SCORE = 0.6  # of one: a clock that jumps once makes one


@njit(cache=True, error_model="numpy")
def check_readings(rows: Any, at: Any, readings: Any, p: Limits, verdicts: Any) -> None:
    """Take `readings` (B,) into the distinct rows `at` (B,) of `rows` (PLAUSIBILITY), and begin the `verdicts` (B,)."""
    for i in range(at.size):
        if i + 1 < at.size:
            prefetch_row(rows, at[i + 1], 0, rows.itemsize)
        check(rows[at[i]], readings[i], p, verdicts[i])


@njit(cache=True, error_model="numpy")
def check(row: Any, z: Any, p: Limits, verdict: Any) -> None:
    """Take one READING; write `observed` and `implausible` of the VERDICT, by which the filter knows of it."""
    east = north = 0.0
    if isfinite(z.heading_deg):
        east, north = sin(radians(z.heading_deg)), cos(radians(z.heading_deg))
    if row.count == 0:
        row.count, row.t_s, row.v_mps, row.speed_since_s = 1, z.t_s, z.v_mps, z.t_s
        row.speed_interval_s = 1.0
        row.heading_east, row.heading_north = east, north
        first_fix(row, z.v_mps)
        row.observed = SPEED_VALUE if z.v_mps > p.speed_mps else 0
        row.since_s = z.t_s
    else:
        _advance(row, z, east, north, p)
    verdict.observed = row.observed
    verdict.implausible = sensor_of(row)


@njit(cache=True, error_model="numpy")
def _advance(row: Any, z: Any, east: float, north: float, p: Limits) -> None:
    """Take a message that is not the first."""
    t_s, v_mps, dt_s = z.t_s, z.v_mps, z.t_s - row.t_s
    accuracy_m = p.accuracy_share * min(z.accuracy_m, 10.0) if z.accuracy_m > 0.0 else 0.0
    quiet = row.observed == 0 and row.short_ms == 0.0
    before_mps, faded, retained = row.v_mps, exp(-dt_s / p.fade_s), exp(-dt_s / p.memory_s)
    row.count += 1
    row.position_score *= faded
    row.speed_score *= faded
    row.jerk_score *= faded
    row.heading_score *= faded
    row.jumps[0] *= retained
    row.jumps[1] *= retained
    row.contradictions = min(row.contradictions * retained + _CONTRADICTION_SCORE * max(z.contradictions, 0.0), 1.5)
    row.surplus = min(max(row.surplus + 1.0 - dt_s / p.interval_s, 0.0), 2.0 * p.burst)
    step = observe_heading(row, dt_s, east, north, v_mps, p)
    step |= observe_speed(row, dt_s, v_mps, p)
    row.way_m += 0.5 * (v_mps + before_mps) * dt_s
    step |= observe_position(row, dt_s, z.east_m, z.north_m, v_mps, p, accuracy_m)
    row.t_s, row.v_mps, row.heading_east, row.heading_north = t_s, v_mps, east, north
    stands = _stands(row, POSITION_CHANGE, row.position_score) | _stands(row, HEADING, row.heading_score)
    stands |= _stands(row, SPEED_CHANGE, row.speed_score) | _stands(row, CONTRADICTION, row.contradictions)
    stands |= _stands(row, POSITION_SPEED, max(row.short_ms, row.long_ms) / p.mismatch_ms)
    stands |= _stands(row, JERK, row.jerk_score)
    stands |= _stands(row, INTERVAL, row.surplus / p.burst)
    stands |= step & (SPEED_VALUE | SPEED_FROZEN | POSITION_FROZEN)
    stands |= (OVERLAP if z.overlapped > 0.0 else 0) | (APPEARANCE if z.appeared > 0.0 else 0)
    if stands & POSITION_CHANGE and row.returns >= _IDENTITY_RETURNS:
        stands |= IDENTITY
    stands |= _changed_motion(row, step, quiet, before_mps, dt_s)
    if row.observed == 0:
        row.since_s = t_s
    if stands & POSITION_SPEED and not row.observed & POSITION_SPEED:
        row.mismatch_sensor = mismatched_sensor(row, v_mps)
    row.observed = stands


@njit(cache=True, error_model="numpy")
def _stands(row: Any, flag: int, score: float) -> int:
    """Return `flag` where its score makes the observation, or keeps the one that stands."""
    return flag if score >= ON or (row.observed & flag and score > OFF) else 0


@njit(cache=True, error_model="numpy")
def _changed_motion(row: Any, step: int, quiet: bool, before_mps: float, dt_s: float) -> int:
    """Return ACCELERATION while a motion stands that both sensors agree upon and that no car can have come to.

    Before it is known whether they agree, it is SPEED_CHANGE.

    It begins with a change of speed beyond limits in a vehicle of which nothing else was observed. It ends when the
    speed is back, when the sensors contradict each other after all, or after a while of plausible driving.
    """
    if step & SPEED_CHANGE and row.speed_score >= ON and quiet and row.count > 10:
        row.change_s, row.change_from_mps, row.plausible_s = row.t_s, before_mps, 0.0
    if row.change_s == 0.0:
        return 0
    agreed = row.short_ms == 0.0 and row.long_ms == 0.0
    if abs(row.v_mps - row.change_from_mps) < _RETURNED_MPS and row.t_s - row.change_s < _RELEASE_S:
        row.change_s = 0.0
        return 0
    if row.t_s - row.change_s < _CONFIRM_S:
        return SPEED_CHANGE
    if not agreed and row.plausible_s == 0.0 and row.t_s - row.change_s < 2.0 * _CONFIRM_S:
        row.change_s = 0.0
        return 0
    row.plausible_s += dt_s if agreed and row.v_mps > 2.0 and step == 0 else 1e-9
    if row.plausible_s > _RELEASE_S:
        row.change_s = 0.0
        return 0
    return ACCELERATION


@njit(cache=True, error_model="numpy")
def sensor_of(row: Any) -> int:
    """Return the `Sensor` that the standing observations concern."""
    seen = row.observed
    if seen & ACCELERATION:
        return _BOTH
    position = seen & (POSITION_CHANGE | POSITION_FROZEN | IDENTITY | CONTRADICTION | OVERLAP) != 0
    speed = seen & (SPEED_CHANGE | SPEED_FROZEN | SPEED_VALUE | JERK) != 0
    if seen & POSITION_SPEED and not (position or speed):
        return int(row.mismatch_sensor)
    if position and speed:
        return _BOTH
    if position or speed:
        return _LOCATION if position else _SPEED
    if seen & HEADING:
        return _HEADING
    return _LINK if seen & (INTERVAL | APPEARANCE) else 0


@njit(cache=True, error_model="numpy")
def kind_of(row: Any) -> int:
    """Return the `Kind` of what is observed: single steps that come and go, or an offset that stays."""
    if row.t_s - row.since_s < _ONSET_S:
        return _UNKNOWN
    steps = max(row.jumps[0], row.jumps[1])
    if steps >= ODD_READING:
        return _NOISE
    return _SHORT if steps > 1.0 and row.observed & (POSITION_SPEED | ACCELERATION) == 0 else _BIAS


@njit(cache=True, error_model="numpy")
def score_of(row: Any, p: Limits) -> float:
    """Return the largest score of the standing observations, 1 being the limit."""
    worst = max(row.position_score, row.speed_score, row.jerk_score, row.heading_score, row.contradictions)
    worst = max(worst, row.short_ms / p.mismatch_ms, row.long_ms / p.mismatch_ms, row.surplus / p.burst)
    if row.observed & (SPEED_VALUE | SPEED_FROZEN | POSITION_FROZEN | ACCELERATION | OVERLAP | APPEARANCE):
        worst = max(worst, 1.0)
    return float(worst)


@njit(cache=True, error_model="numpy")
def combine(rows: Any, at: Any, p: Limits, verdicts: Any) -> None:
    """Make the filter's `verdicts` (B,) those of filter and checks together: what is observed is anomalous.

    The kind is the filter's where it finds the same sensor at fault, for it sees the shape of the readings.
    """
    for i in range(at.size):
        verdict = verdicts[i]
        if verdict.observed == 0:
            continue
        row = rows[at[i]]
        sensor = verdict.implausible
        if not verdict.anomalous:
            verdict.statistic, verdict.gate, verdict.p_value = score_of(row, p), ON, 0.0
        if not (verdict.anomalous and verdict.sensor & sensor):
            verdict.kind, verdict.confidence = kind_of(row), 0.5
        verdict.anomalous, verdict.sensor = True, sensor
