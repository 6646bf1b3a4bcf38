"""The distance of one vehicle behind another, along the path of the one ahead.

The path history of the vehicle ahead stands for the road: it passes beside the follower, in the same direction. If it
is too short to reach back to the follower, it is continued straight from its oldest end.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.geodesy import displacement_m
from headway.core.tracking.odometer import CRUMB_SPACING_M
from headway.core.tracking.tracks import CRUMB_EAST, CRUMB_NORTH, CRUMB_X, CRUMBS

_PATH_COS_MIN = 0.77  # 40 degrees: a base lags its vehicle by up to one spacing of a tight turn
_STRAIGHT_COS_MIN = 0.97  # 14 degrees, on the straight continuation
_BASELINE = 2  # crumbs to either side that define the direction of a path


@njit(cache=True, error_model="numpy")
def between_bases(from_track: Any, to_track: Any) -> tuple[float, float]:
    """Return (east_m, north_m) from the first base to the second."""
    return displacement_m(
        from_track.base_lat_deg, from_track.base_lon_deg, to_track.base_lat_deg, to_track.base_lon_deg
    )


@njit(cache=True, error_model="numpy")
def distance_along_path(ahead: Any, behind: Any, corridor_m: float, range_m: float) -> tuple[float, float]:
    """Return (metres from `behind` to `ahead` along the path of `ahead`, metres of `behind` to the left of the path).

    The metres are 0 if the path does not pass within `corridor_m` of the base of `behind`, in its direction, over the
    last `range_m`. Of several passes the newest counts. The search goes backwards in leaps: a place r away from a crumb
    is not beside the path within r - corridor_m before that crumb.
    """
    heading_east, heading_north = behind.base_heading_east, behind.base_heading_north
    if ahead.crumb_count == 0 or (heading_east == 0.0 and heading_north == 0.0):
        return 0.0, 0.0
    east_m, north_m = between_bases(ahead, behind)
    east_m += ahead.base_east_m
    north_m += ahead.base_north_m
    crumbs = ahead.crumbs
    newest = ahead.newest_crumb
    oldest_back = ahead.crumb_count - 1
    spacing_m = CRUMB_SPACING_M
    if oldest_back > 0:
        oldest = (newest - oldest_back) & (CRUMBS - 1)
        spacing_m = max((crumbs[newest, CRUMB_X] - crumbs[oldest, CRUMB_X]) / oldest_back, CRUMB_SPACING_M)

    best_squared = corridor_m * corridor_m
    place_m = np.inf
    lateral_m = 0.0
    back = 0
    while back < oldest_back:
        newer = (newest - back) & (CRUMBS - 1)
        if ahead.base_x_m - crumbs[newer, CRUMB_X] > range_m:
            return 0.0, 0.0
        to_east = east_m - crumbs[newer, CRUMB_EAST]
        to_north = north_m - crumbs[newer, CRUMB_NORTH]
        leap_m = 0.9 * (math.sqrt(to_east * to_east + to_north * to_north) - corridor_m)
        leap = min(int(leap_m / spacing_m), oldest_back - back)
        while leap > 0 and crumbs[newer, CRUMB_X] - crumbs[(newer - leap) & (CRUMBS - 1), CRUMB_X] > leap_m:
            leap -= 1
        if leap > 0:
            if place_m != np.inf:
                break
            best_squared = corridor_m * corridor_m
            back += leap
            continue
        older = (newer - 1) & (CRUMBS - 1)
        along_east = crumbs[newer, CRUMB_EAST] - crumbs[older, CRUMB_EAST]
        along_north = crumbs[newer, CRUMB_NORTH] - crumbs[older, CRUMB_NORTH]
        length_squared = max(along_east * along_east + along_north * along_north, 1e-6)
        beyond = 1.0 + (to_east * along_east + to_north * along_north) / length_squared
        part = min(max(beyond, 0.0), 1.0)
        beside_east = to_east + (1.0 - part) * along_east
        beside_north = to_north + (1.0 - part) * along_north
        apart_squared = beside_east * beside_east + beside_north * beside_north
        back += 1
        if apart_squared >= best_squared:
            if place_m != np.inf:
                break
            continue
        path_east, path_north = _path_direction(crumbs, newest, back - 1, oldest_back)
        if path_east * heading_east + path_north * heading_north < _PATH_COS_MIN:
            continue
        best_squared = apart_squared
        if (beyond > 1.0 and back == 1) or (beyond < 0.0 and back == oldest_back):
            place_m = np.inf
            continue
        place_m = crumbs[older, CRUMB_X] + part * (crumbs[newer, CRUMB_X] - crumbs[older, CRUMB_X])
        lateral_m = math.copysign(math.sqrt(apart_squared), along_east * beside_north - along_north * beside_east)
    if place_m == np.inf:
        place_m, lateral_m = _continue_straight(ahead, east_m, north_m, heading_east, heading_north, corridor_m)
    ahead_m = ahead.base_x_m - place_m
    return (ahead_m, lateral_m) if 0.0 < ahead_m <= range_m else (0.0, 0.0)


@njit(cache=True, error_model="numpy")
def _continue_straight(
    ahead: Any, east_m: float, north_m: float, heading_east: float, heading_north: float, corridor_m: float
) -> tuple[float, float]:
    """Return (odometer, lateral) on the straight continuation behind the oldest crumb; inf if not on it."""
    crumbs = ahead.crumbs
    oldest_back = ahead.crumb_count - 1
    oldest = (ahead.newest_crumb - oldest_back) & (CRUMBS - 1)
    path_east, path_north = ahead.base_heading_east, ahead.base_heading_north
    if oldest_back > 2 * _BASELINE:
        path_east, path_north = _path_direction(crumbs, ahead.newest_crumb, oldest_back - _BASELINE, oldest_back)
    if path_east * heading_east + path_north * heading_north < _STRAIGHT_COS_MIN:
        return np.inf, 0.0
    to_east = east_m - crumbs[oldest, CRUMB_EAST]
    to_north = north_m - crumbs[oldest, CRUMB_NORTH]
    along_m = to_east * path_east + to_north * path_north
    lateral_m = path_east * to_north - path_north * to_east
    if along_m > 0.0 or abs(lateral_m) > corridor_m:
        return np.inf, 0.0
    return crumbs[oldest, CRUMB_X] + along_m, lateral_m


@njit(cache=True, error_model="numpy")
def _path_direction(crumbs: NDArray[np.float32], newest: int, back: int, oldest_back: int) -> tuple[float, float]:
    """Return the unit direction of the path around the segment that starts `back` crumbs before the newest."""
    newer = (newest - max(back - _BASELINE + 1, 0)) & (CRUMBS - 1)
    older = (newest - min(back + _BASELINE, oldest_back)) & (CRUMBS - 1)
    east = crumbs[newer, CRUMB_EAST] - crumbs[older, CRUMB_EAST]
    north = crumbs[newer, CRUMB_NORTH] - crumbs[older, CRUMB_NORTH]
    length = math.hypot(east, north)
    return (east / length, north / length) if length > 0.0 else (0.0, 0.0)
