"""Two vehicles in one place: bodies that overlap by more than the accuracies of both allow, while both drive.

An overlap does not show which of the two is wrong. Named is the one that was first received in the place of the other,
which had been known for long. Of two that have both been known for long, or of two new ones, neither is named.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from headway.core.tracking.geodesy import displacement_m
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

OVERLAP = np.dtype(
    [
        ("row", "i8"),  # of the other, counted from 1; 0: none yet
        ("generation", "i8"),
        ("since_us", "i8"),
        ("newest_us", "i8"),
        ("count", "i8"),  # readings of this vehicle when it began
        ("named_us", "i8"),  # when this vehicle was last named for it
    ],
    align=True,
)
"""The newest overlap of a vehicle; all zeros is none."""

PERSISTS_US = 1_500_000
"""Three searches: vehicles that pass each other overlap for less."""
ENDS_US = 1_200_000
"""Two searches without it end an overlap."""
NEW_READINGS, KNOWN_READINGS = 30, 100
"""A vehicle with fewer readings came into an overlap with one that has more than the second."""

_MOVING_MPS = 3.0  # vehicles at rest may stand above each other
_SAME_COURSE_COS = 0.9
_NEAR_M = 15.0  # of the places in the index, which are up to a spacing and 0.25 s old
_REACH_M = 2.3  # of positions that are measured at the front, the antenna or the centre of a body
_WIDTH_M = 1.3  # of two bodies side by side, with antennas half a metre aside
_STD = 1.5
_APART_US = 1_000_000


@njit(cache=True, error_model="numpy")
def observe_overlap(tracks: Records, row: int, nearby: I64, apart_squared: F64, count: int) -> None:
    """Take the nearest vehicles (`count`,) of one whose leader is searched; `apart_squared` is sorted."""
    track = tracks[row]
    for k in range(count):
        if apart_squared[k] > _NEAR_M * _NEAR_M:
            return
        other = tracks[nearby[k]]
        if not _overlap(track, other):
            continue
        _continue_overlap(track, nearby[k], other.generation, track.t_us)
        _continue_overlap(other, row, track.generation, track.t_us)
        mine, others = track.overlap, other.overlap
        if track.t_us - max(mine.since_us, others.since_us) < PERSISTS_US:
            return
        if mine.count < NEW_READINGS and others.count > KNOWN_READINGS:
            mine.named_us = track.t_us
        elif others.count < NEW_READINGS and mine.count > KNOWN_READINGS:
            others.named_us = track.t_us
        return


@njit(cache=True, error_model="numpy")
def is_named(track: Any) -> bool:
    """Whether a vehicle is in the place of another now, and wrong."""
    return bool(track.overlap.named_us > 0 and track.t_us - track.overlap.named_us < ENDS_US)


@njit(cache=True, error_model="numpy")
def _continue_overlap(track: Any, other_row: int, other_generation: int, t_us: int) -> None:
    """Continue the overlap of a vehicle with another at `t_us`, or begin one."""
    mine = track.overlap
    if mine.row != other_row + 1 or mine.generation != other_generation or t_us - mine.newest_us > ENDS_US:
        mine.row, mine.generation = other_row + 1, other_generation
        mine.since_us, mine.count = t_us, track.count
    mine.newest_us = t_us


@njit(cache=True, error_model="numpy")
def _overlap(track: Any, other: Any) -> bool:
    """Whether two moving bodies overlap, whatever their accuracies; those that declare none do not."""
    if not (track.accuracy_m > 0.0 and other.accuracy_m > 0.0):
        return False
    if min(track.v_mps, other.v_mps) < _MOVING_MPS or abs(track.t_us - other.t_us) > _APART_US:
        return False
    east, north = track.heading_east, track.heading_north
    if east * other.heading_east + north * other.heading_north < _SAME_COURSE_COS:
        return False
    east_m, north_m = displacement_m(track.lat_deg, track.lon_deg, other.lat_deg, other.lon_deg)
    moved_m = other.v_mps * 1e-6 * (track.t_us - other.t_us)
    unsure_m = _STD * math.hypot(track.accuracy_m, other.accuracy_m)
    ahead_m = abs(east_m * east + north_m * north + moved_m)
    aside_m = abs(east_m * north - north_m * east)
    reach_m = 0.5 * (track.length_m + other.length_m) - _REACH_M
    return bool(ahead_m + unsure_m < reach_m and aside_m + unsure_m < _WIDTH_M)
