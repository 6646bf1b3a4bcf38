"""The odometer: from latitude and longitude to the one dimension of the filter.

`x_m` is measured from the *base*, the newest place with a valid location, and never from the last reading. With d the
displacement from the base, h0 and h the unit headings at the base and now, and phi the angle between them,

    x = x_base + (d . m) (phi / 2) / sin(phi / 2),        m = (h0 + h) / |h0 + h|

is the arc length of the circle through both places. The factor is taken as 1 + (1 - h0 . h) / 12, its value to second
order in phi. An invalid location makes one invalid `x_m` and has no effect on the next.

**At rest.** A speed has no sign, and a heading may be that of long ago. So a vehicle at rest takes its base along, and
from there it drives where its positions go. Until they show that, or where they leave the heading, `odometer_std_m`
says how uncertain `x_m` is.
"""

import math
from typing import Any

from numba import njit

from headway.core.tracking.geodesy import displacement_m

CRUMB_SPACING_M = 3.0
"""Short for the curves of a lane (an arc of 60 m radius leaves its chord by 2 cm), long against position noise."""

MOVING_MPS = 0.5
"""Below this speed a receiver's heading is noise; a vehicle at rest keeps its heading."""

RESTING_MPS = 0.1
"""Below this speed a vehicle may start to drive backwards."""

BACKWARDS_MPS = 5.0
"""Nobody drives backwards faster."""

SHOWN_STD = 6.0
"""Standard deviations of a reading's innovation by which positions must go backwards to show it."""

TURN_COS_MIN = 0.5
"""No vehicle turns by more than 60 degrees within one spacing."""

SIDESLIP_STD = 4.0
"""Standard deviations of a reading's innovation by which a chord must leave its mean heading to show a sideslip."""

_TURN_SIN_MIN = 0.05  # 3 degrees within a chord: at a radius of 60 m or less
_CHORD_MIN_M = 0.5 * CRUMB_SPACING_M  # shorter ones have no direction in the noise
_RESOLUTION_M = 0.01


@njit(cache=True, error_model="numpy")
def rests(track: Any, step_m: float) -> bool:
    """Whether the vehicle stands: by its speed, and by the step of its position."""
    return bool(track.v_mps < RESTING_MPS and step_m < _shown_m(track))


@njit(cache=True, error_model="numpy")
def _shown_m(track: Any) -> float:
    """Return the displacement that noise does not explain."""
    return float(SHOWN_STD * max(track.innovation_std_m, _RESOLUTION_M))


@njit(cache=True, error_model="numpy")
def update_odometer(track: Any, heading_deg: float) -> None:
    """Set heading and odometer of the newest reading, relative to the base."""
    east_m, north_m = displacement_m(track.base_lat_deg, track.base_lon_deg, track.lat_deg, track.lon_deg)
    track.from_base_east_m, track.from_base_north_m = east_m, north_m
    apart_m = math.hypot(east_m, north_m)
    moving = track.v_mps >= MOVING_MPS or apart_m >= CRUMB_SPACING_M
    known = track.base_heading_east != 0.0 or track.base_heading_north != 0.0
    track.heading_declared = moving and math.isfinite(heading_deg)
    if track.heading_declared or (math.isfinite(heading_deg) and not known):
        track.heading_east = math.sin(math.radians(heading_deg))
        track.heading_north = math.cos(math.radians(heading_deg))
    elif moving:
        _derive_heading(track, apart_m)
    if known and RESTING_MPS <= track.v_mps < BACKWARDS_MPS:
        _turn_to_motion(track)
    if not track.heading_known and (moving or not known):
        track.base_heading_east, track.base_heading_north = track.heading_east, track.heading_north
        track.heading_known = track.heading_declared or (moving and apart_m >= _CHORD_MIN_M)

    cosine = turn_cos(track)
    if cosine < TURN_COS_MIN:
        ahead_m = east_m * track.heading_east + north_m * track.heading_north
    else:
        mean_east = track.base_heading_east + track.heading_east
        mean_north = track.base_heading_north + track.heading_north
        if track.sideslip != 0.0:
            mean_east, mean_north = mean_east + track.sideslip * mean_north, mean_north - track.sideslip * mean_east
        ahead_m = (east_m * mean_east + north_m * mean_north) / math.hypot(mean_east, mean_north)
        ahead_m *= 1.0 + (1.0 - cosine) / 12.0
    track.odometer_std_m = 0.0
    if track.base_resting and track.v_mps >= RESTING_MPS:
        if ahead_m < 0.0:
            track.odometer_std_m = -2.0 * ahead_m
        else:
            # The heading at rest is that of long ago: the way is between the chord and its part along the heading.
            track.odometer_std_m = 0.5 * max(apart_m - ahead_m, 0.0)
            ahead_m += track.odometer_std_m
    track.x_m = track.base_x_m + ahead_m


@njit(cache=True, error_model="numpy")
def update_sideslip(track: Any) -> None:
    """Set the sideslip by the chord from the base to the newest reading, before that becomes the base."""
    track.sideslip = 0.0
    east, north = track.base_heading_east + track.heading_east, track.base_heading_north + track.heading_north
    length = math.hypot(east, north)
    to_the_right = track.base_heading_north * track.heading_east - track.base_heading_east * track.heading_north
    if not track.heading_declared or turn_cos(track) < TURN_COS_MIN or abs(to_the_right) < _TURN_SIN_MIN:
        return
    ahead_m = (track.from_base_east_m * east + track.from_base_north_m * north) / length
    aside_m = (track.from_base_east_m * north - track.from_base_north_m * east) / length
    if to_the_right < 0.0:
        aside_m = -aside_m
    shown_m = SIDESLIP_STD * max(track.innovation_std_m, _RESOLUTION_M)
    if ahead_m > _CHORD_MIN_M and shown_m < aside_m < ahead_m:
        track.sideslip = math.copysign(aside_m / ahead_m, to_the_right)


@njit(cache=True, error_model="numpy")
def _turn_to_motion(track: Any) -> None:
    """Turn the heading round if the vehicle drives backwards, or declares the course while it does.

    From a place of rest it drives where its positions go, as soon as they show it; then it drives as before.
    """
    east, north = track.base_heading_east, track.base_heading_north
    if track.base_resting:
        ahead_m = track.from_base_east_m * east + track.from_base_north_m * north
        if ahead_m < -_shown_m(track):
            east, north = -east, -north
            track.base_heading_east, track.base_heading_north = east, north
    if track.heading_east * east + track.heading_north * north < 0.0:
        track.heading_east, track.heading_north = -track.heading_east, -track.heading_north


@njit(cache=True, error_model="numpy")
def _derive_heading(track: Any, apart_m: float) -> None:
    """Set the heading by the displacement from the base, for a sender that declares none."""
    if apart_m < (_CHORD_MIN_M if track.heading_known else 1e-3):
        return
    east, north = track.from_base_east_m / apart_m, track.from_base_north_m / apart_m
    if track.heading_known and east * track.base_heading_east + north * track.base_heading_north < TURN_COS_MIN:
        return
    track.heading_east, track.heading_north = east, north


@njit(cache=True, error_model="numpy")
def turn_cos(track: Any) -> float:
    """Return the cosine of the angle between the headings at the base and now."""
    return float(track.base_heading_east * track.heading_east + track.base_heading_north * track.heading_north)
