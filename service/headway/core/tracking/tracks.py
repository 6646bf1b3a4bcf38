"""One row for each vehicle: its newest reading, its odometer (`odometer`), and its path history.

**Path history.** `advance` reads the base; `extend_path_history` moves it after the verdict. A reading with a valid
location becomes the base when it is `CRUMB_SPACING_M` further on. If the location is invalid, the recovered speed moves
the base. Each place of the base is stored in a ring of crumbs (SAE J2735 PathHistory, crumbData).

East and north are metres in a plane that moves with the vehicle, from an arbitrary origin for each row. Only the
differences within one row have a meaning.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.runtime.prefetch import prefetch_row
from headway.core.runtime.rows import wipe
from headway.core.tracking.geodesy import displaced_deg, displacement_m
from headway.core.tracking.odometer import (
    CRUMB_SPACING_M,
    TURN_COS_MIN,
    rests,
    turn_cos,
    update_odometer,
    update_sideslip,
)
from headway.core.tracking.overlap import OVERLAP
from headway.core.types.batch import F64, I64, Columns
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records

CRUMBS = 64
"""Crumbs of each path: 192 m at the closest spacing. A power of two."""

DEFAULT_LENGTH_M = 4.7
"""A passenger car, for a sender that declares no length."""

MSG_CNT_MODULUS = 128

CRUMB_EAST, CRUMB_NORTH, CRUMB_X = 0, 1, 2
"""Columns of a crumb."""

_INTERVAL_GAIN = 1.0 / 16.0
_INTERVAL_MIN_S = 0.01
_LONGEST_KEPT = 0.99  # of a longest interval, or run of losses, with each message
_LOSS_KEPT = 15.0 / 16.0  # of a share of losses, with each message
_FIRST_INTERVAL_S = 0.1  # 10 Hz until the interval of the sender is known (SAE J2945/1)
_BREAK_M = 50.0
_ACCEPTED = int(Outcome.SCORED)
_DUPLICATE = int(Outcome.DUPLICATE)
_OUT_OF_ORDER = int(Outcome.OUT_OF_ORDER)
_FROM_THE_FUTURE = int(Outcome.FROM_THE_FUTURE)
_CONTRADICTION = int(Outcome.CONTRADICTION)
AHEAD_MAX_S = 0.25
"""A message may be dated so far ahead of its sender's own clock, or it would make the next ones out of order. Delays on
the way vary by less."""
_AGE_RATE, _AGE_GAP_S = 0.2, 0.2  # s/s, s: a clock that was set by 1 s is followed within 4 s
_COMPARABLE_S, _ELSEWHERE_M, _ACCEL_MPS2 = 1.2, 2.5, 8.0  # as a late message of one sender may differ at most
_SAME_M, _SAME_MPS = 0.5, 0.5  # copies of one message differ by the rounding of gateways

TRACK = np.dtype(
    [
        ("t_us", "i8"),  # event time of the newest reading
        ("received_us", "i8"),
        ("age_us", "i8"),  # receive time less event time, a median over time; at first at most 0
        ("aged_us", "i8"),  # receive time of the newest message that entered it
        ("generation", "i8"),  # changes when x_m starts at zero: another vehicle, or a gap
        ("msg_cnt", "i8"),
        ("counting", "?"),  # its counter went up by one with the last message
        ("count", "i8"),  # readings since x_m was zero
        ("step_s", "f8"),  # event time between the last two readings
        ("interval_s", "f8"),  # the sender's mean interval; 0: the row is free
        ("longest_interval_s", "f8"),  # its longest interval of late
        ("loss", "f8"),  # share of its messages lost of late
        ("longest_loss", "f8"),  # longest run of lost messages of late
        ("cell_key", "i8"),  # cell of `coverage` that it was in last; 0: none yet
        ("appeared_us", "i8"),  # event time of its sudden appearance; 0: none
        ("appearance_stands", "?"),  # nothing else explains it
        ("overlap", OVERLAP),
        ("lat_deg", "f8"),
        ("lon_deg", "f8"),
        ("step_east_m", "f8"),  # displacement between the last two readings
        ("step_north_m", "f8"),
        ("contradictions", "i8"),  # messages since the newest reading that one sender cannot have sent beside it
        ("x_m", "f8"),
        ("odometer_std_m", "f8"),  # of x_m, where the vehicle sets off in a direction that is not known
        ("innovation_std_m", "f8"),  # by which a reading of x_m may differ from its prediction
        ("v_mps", "f8"),
        ("heading_east", "f8"),  # unit vector; (0, 0): unknown
        ("heading_north", "f8"),
        ("heading_declared", "?"),  # by the newest reading, in motion
        ("heading_known", "?"),  # from a reading in motion
        ("accuracy_m", "f8"),  # declared, 1 sigma; NaN: never
        ("length_m", "f8"),
        ("from_base_east_m", "f8"),  # newest reading, relative to the base
        ("from_base_north_m", "f8"),
        ("base_lat_deg", "f8"),
        ("base_lon_deg", "f8"),
        ("base_x_m", "f8"),
        ("base_east_m", "f8"),
        ("base_north_m", "f8"),
        ("base_heading_east", "f8"),
        ("base_heading_north", "f8"),
        ("sideslip", "f8"),  # tangent of the angle from heading to course, to the right, in a turn; 0: not shown
        ("base_resting", "?"),  # the vehicle was at rest there
        ("newest_crumb", "i8"),
        ("crumb_count", "i8"),
        ("crumbs", "f4", (CRUMBS, 3)),  # ring of EAST, NORTH, X: to 4 mm after 100 km
    ],
    align=True,
)

_CRUMBS_START = dict(TRACK.fields or {})["crumbs"][1]


def new_tracks(capacity: int) -> Records:
    """Return `capacity` free rows of dtype TRACK."""
    return np.zeros(capacity, TRACK)


@njit(cache=True, error_model="numpy")
def is_free(track: Any) -> bool:
    """Whether the row has no vehicle; a reading may have any event time, 0 too."""
    return bool(track.interval_s == 0.0)


def evict(tracks: Records, rows: I64) -> None:
    """Free the rows. Their generation increases, so the next vehicle of a row is not taken for this one."""
    generation = tracks["generation"][rows] + 1
    wipe(tracks, rows)
    tracks["generation"][rows] = generation


class Advance(NamedTuple):
    """What `advance` did with each of n records."""

    outcome: NDArray[np.uint8]
    """DUPLICATE, CONTRADICTION, OUT_OF_ORDER, FROM_THE_FUTURE, or SCORED for a record that the row has taken."""
    sequence_gap: I64
    """Messages lost before this one, by `msg_cnt`."""
    initialised: NDArray[np.bool_]
    """Whether the odometer starts at zero: a new vehicle, or a gap above `max_gap_s`."""


@njit(cache=True, error_model="numpy")
def advance(tracks: Records, rows: I64, batch: Columns, places: I64, max_gap_s: float) -> Advance:
    """Take one record into each of the distinct `rows` (n,); `places` (n,) are the records' places in the batch.

    A record with the event time of the newest one and another position or speed is a contradiction, and is counted. One
    with the same event time and `msg_cnt` is a duplicate. Any other that is not newer is out of order. One ahead of the
    sender's own clock is from the future. All four leave the reading of the row as it is. The last two are counted as
    contradictions too where the vehicle cannot have been in that place.

    Latitude, longitude and speed must be finite; heading, accuracy and length may be NaN.
    """
    done = Advance(np.empty(rows.size, np.uint8), np.zeros(rows.size, np.int64), np.zeros(rows.size, np.bool_))
    for i in range(rows.size):
        if i + 1 < rows.size:
            prefetch_row(tracks, rows[i + 1], 0, _CRUMBS_START)
        track, k = tracks[rows[i]], places[i]
        if _is_ahead(track, batch.received_us[k] - batch.t_us[k], batch.received_us[k]):
            done.outcome[i] = _FROM_THE_FUTURE
            track.contradictions += _is_elsewhere(track, batch, k)
            continue
        if batch.t_us[k] <= track.t_us and not is_free(track):
            done.outcome[i] = _OUT_OF_ORDER
            if batch.t_us[k] == track.t_us and _contradicts(track, batch, k):
                done.outcome[i] = _CONTRADICTION
                track.contradictions += 1
            elif batch.t_us[k] == track.t_us and batch.msg_cnt[k] == track.msg_cnt:
                done.outcome[i] = _DUPLICATE
            else:
                track.contradictions += _is_elsewhere(track, batch, k)
            continue
        done.outcome[i] = _ACCEPTED
        step_s = 1e-6 * (batch.t_us[k] - track.t_us)
        if is_free(track) or step_s > max_gap_s:
            done.sequence_gap[i] = _long_sequence_gap(track, batch.msg_cnt[k], step_s)
            _initialise(track, batch.lat_deg[k], batch.lon_deg[k])
            done.initialised[i] = True
        else:
            done.sequence_gap[i] = _sequence_gap(track, batch.msg_cnt[k], step_s, max_gap_s)
            track.step_s = step_s
            track.step_east_m, track.step_north_m = displacement_m(
                track.lat_deg, track.lon_deg, batch.lat_deg[k], batch.lon_deg[k]
            )
        track.t_us = batch.t_us[k]
        track.received_us = batch.received_us[k]
        track.msg_cnt = batch.msg_cnt[k]
        track.count += 1
        track.lat_deg = batch.lat_deg[k]
        track.lon_deg = batch.lon_deg[k]
        track.v_mps = batch.speed_mps[k]
        if batch.accuracy_m[k] >= 0.0:
            track.accuracy_m = batch.accuracy_m[k]
        if batch.length_m[k] > 0.0:
            track.length_m = batch.length_m[k]
        update_odometer(track, batch.heading_deg[k])
        if done.initialised[i]:
            _push_crumb(track)
    return done


@njit(cache=True, error_model="numpy")
def extend_path_history(
    tracks: Records, rows: I64, location_valid: NDArray[np.bool_], v_mps: F64, innovation_variance: F64
) -> None:
    """Move each row's base after the verdict on its newest reading; once for each reading that `advance` accepted.

    `location_valid` (B,): the filter did not reject the location. `v_mps` (B,): the recovered speed, which moves the
    base where the location is invalid. `innovation_variance` (B,) is that of `x_m`, m^2. A valid reading too far from
    the base clears the path, not the odometer.
    """
    for i in range(rows.size):
        track = tracks[rows[i]]
        track.innovation_std_m = math.sqrt(max(innovation_variance[i] - track.odometer_std_m**2, 0.0))
        if location_valid[i]:
            east_m, north_m = track.from_base_east_m, track.from_base_north_m
            apart_m = math.hypot(east_m, north_m)
            resting = rests(track, math.hypot(track.step_east_m, track.step_north_m))
            if not resting and track.x_m - track.base_x_m < CRUMB_SPACING_M and apart_m < 3.0 * CRUMB_SPACING_M:
                continue
            if apart_m > _BREAK_M + 2.0 * track.v_mps * track.step_s:
                track.crumb_count = 0
            track.base_lat_deg, track.base_lon_deg = track.lat_deg, track.lon_deg
            track.base_x_m, track.base_resting = track.x_m, resting
            update_sideslip(track)
            if not (track.heading_declared or resting):
                track.heading_east, track.heading_north = east_m / apart_m, north_m / apart_m
            track.base_heading_east, track.base_heading_north = track.heading_east, track.heading_north
        else:
            track.sideslip = 0.0
            travelled_m = v_mps[i] * track.step_s
            east_m = 0.5 * travelled_m * track.base_heading_east
            north_m = 0.5 * travelled_m * track.base_heading_north
            if track.heading_declared and turn_cos(track) >= TURN_COS_MIN:
                track.base_heading_east, track.base_heading_north = track.heading_east, track.heading_north
            east_m += 0.5 * travelled_m * track.base_heading_east
            north_m += 0.5 * travelled_m * track.base_heading_north
            track.base_lat_deg, track.base_lon_deg = displaced_deg(
                track.base_lat_deg, track.base_lon_deg, east_m, north_m
            )
            track.base_x_m += travelled_m
            track.base_resting = False
        track.base_east_m += east_m
        track.base_north_m += north_m
        track.from_base_east_m = track.from_base_north_m = 0.0
        if track.crumb_count == 0 or track.base_x_m - track.crumbs[track.newest_crumb, CRUMB_X] >= CRUMB_SPACING_M:
            _push_crumb(track)


@njit(cache=True, error_model="numpy")
def _initialise(track: Any, lat_deg: float, lon_deg: float) -> None:
    """Set the odometer to zero at this place, with an empty path."""
    if is_free(track):
        track.length_m = DEFAULT_LENGTH_M
        track.accuracy_m = np.nan
        track.interval_s = track.longest_interval_s = _FIRST_INTERVAL_S
    track.generation += 1
    track.count = 0
    track.step_s = track.step_east_m = track.step_north_m = 0.0
    track.heading_east = track.heading_north = 0.0
    track.heading_known = False
    track.base_lat_deg, track.base_lon_deg = lat_deg, lon_deg
    track.base_x_m = track.base_east_m = track.base_north_m = 0.0
    track.base_heading_east = track.base_heading_north = 0.0
    track.base_resting = False
    track.sideslip = 0.0
    track.crumb_count = 0


@njit(cache=True, error_model="numpy")
def _contradicts(track: Any, batch: Columns, k: int) -> bool:
    """Whether record `k`, of the newest reading's time, is more than a copy of it."""
    east_m, north_m = displacement_m(track.lat_deg, track.lon_deg, batch.lat_deg[k], batch.lon_deg[k])
    return bool(math.hypot(east_m, north_m) > _SAME_M or abs(batch.speed_mps[k] - track.v_mps) > _SAME_MPS)


@njit(cache=True, error_model="numpy")
def _is_elsewhere(track: Any, batch: Columns, k: int) -> bool:
    """Whether record `k`, of another time than the newest reading, is where that vehicle cannot be then."""
    dt_s = 1e-6 * (batch.t_us[k] - track.t_us)
    if is_free(track) or abs(dt_s) > _COMPARABLE_S:
        return False
    east_m, north_m = displacement_m(track.lat_deg, track.lon_deg, batch.lat_deg[k], batch.lon_deg[k])
    way_m = dt_s * track.v_mps
    room_m = _ELSEWHERE_M + 0.5 * _ACCEL_MPS2 * dt_s * dt_s
    if track.accuracy_m > 0.0:
        room_m += track.accuracy_m
    return bool(math.hypot(east_m - way_m * track.heading_east, north_m - way_m * track.heading_north) > room_m)


@njit(cache=True, error_model="numpy")
def _is_ahead(track: Any, age_us: int, received_us: int) -> bool:
    """Whether a message is dated ahead of its sender's own clock; `age_us` is its receive time less its event time.

    The clock is the median age, each message weighted by the time since the one before. So neither a burst after a
    delay nor a few messages of another sender under this id move it far.
    """
    if is_free(track):
        track.age_us = min(age_us, 0)
    else:
        limit_us = int(_AGE_RATE * min(max(received_us - track.aged_us, 0), 1e6 * _AGE_GAP_S))
        track.age_us += min(max(age_us - track.age_us, -limit_us), limit_us)
    track.aged_us = max(track.aged_us, received_us)
    return bool(age_us < track.age_us - 1e6 * AHEAD_MAX_S)


@njit(cache=True, error_model="numpy")
def _long_sequence_gap(track: Any, msg_cnt: int, step_s: float) -> int:
    """Return the messages lost in a gap that starts the odometer anew: the number nearest to the time that passed."""
    if is_free(track) or not track.counting:
        return 0
    behind = (msg_cnt - track.msg_cnt) % MSG_CNT_MODULUS
    wraps = math.floor((step_s / track.interval_s - behind) / MSG_CNT_MODULUS + 0.5)
    return int(max(behind + MSG_CNT_MODULUS * wraps - 1, 0))


@njit(cache=True, error_model="numpy")
def _sequence_gap(track: Any, msg_cnt: int, step_s: float, max_gap_s: float) -> int:
    """Return the messages lost before this one, and update the sender's mean interval.

    A counter step of n means n - 1 lost messages if the elapsed time is at least n half intervals. Otherwise the
    counter was restarted, or is constant, and has no meaning.
    """
    sent = (msg_cnt - track.msg_cnt) % MSG_CNT_MODULUS
    track.counting = sent == 1 or (sent > 1 and track.counting)
    if sent == 0 or (sent > 1 and step_s < 0.5 * track.interval_s * sent):
        sent = 1
    interval_s = min(max(step_s / sent, _INTERVAL_MIN_S), max_gap_s)
    gain = max(_INTERVAL_GAIN, 1.0 / (track.count + 1.0))
    track.interval_s += gain * (interval_s - track.interval_s)
    track.longest_interval_s = max(_LONGEST_KEPT * track.longest_interval_s, interval_s)
    track.longest_loss = max(_LONGEST_KEPT * track.longest_loss, float(sent - 1))
    track.loss = (1.0 - _LOSS_KEPT ** (sent - 1) * (1.0 - track.loss)) * _LOSS_KEPT
    return int(sent - 1)


@njit(cache=True, error_model="numpy")
def _push_crumb(track: Any) -> None:
    """Store the place of the base."""
    track.newest_crumb = (track.newest_crumb + 1) & (CRUMBS - 1)
    track.crumb_count = min(track.crumb_count + 1, CRUMBS)
    crumb = track.crumbs[track.newest_crumb]
    crumb[CRUMB_EAST] = track.base_east_m
    crumb[CRUMB_NORTH] = track.base_north_m
    crumb[CRUMB_X] = track.base_x_m
