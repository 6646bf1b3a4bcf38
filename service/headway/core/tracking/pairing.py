"""The leader of each vehicle, and the leader's place on the follower's odometer.

**In one lane.** The leader has been where the follower is now: its path passes beside the follower, within half a lane
and in the same direction. Distances are measured along that path, so bends and turns at a crossing need no map. The
next lane, the opposite lane and a crossing road are excluded at the place of the follower. A path too short to reach
back to the follower is continued straight from its oldest end.

**Leader.** The lane reference is the nearest vehicle ahead whose path passes beside the follower. A vehicle between the
two that is on the path of the lane reference has cut in, and is the leader. If the lane reference is beside the path of
the second vehicle, a lane away, it has left the lane, and the second takes its place. A declared leader is accepted if
that vehicle is known, fresh, and ahead within range.

**Hysteresis.** Each vehicle searches about twice a second of event time. A candidate must be found by several searches
in a row. A leader is kept in a wider corridor, and is lost after several searches without it.

**Offset.** x_leader + `offset_m` is the leader's place on the follower's odometer. The offset is the follower's
odometer less the leader's odometer at the place on the leader's path abreast of the follower. Both places are bases of
`tracks`, so an invalid location of either has no effect, and an error along the road cancels. The offset moves by at
most a share of the distance travelled, because two paths differ in length by no more.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.overlap import observe_overlap
from headway.core.tracking.path_history import between_bases, distance_along_path
from headway.core.tracking.spatial_index import NEAREST, REBUILD_US, Grid, build, find_near
from headway.core.tracking.tracks import is_free
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

NO_LEADER = -1
"""Row of the leader of a vehicle without one."""

SEARCH_EVERY_US = 500_000
"""Event time from one search to the next, us: two searches a second (ADR 0003)."""

CONFIRMATIONS_TO_ACQUIRE = 2
"""Searches in a row before a candidate becomes the leader of a vehicle without one."""

CONFIRMATIONS_TO_REPLACE = 3
"""Searches in a row before a candidate replaces a leader: a receiver may be off by a lane for a second."""

COASTS_TO_LOSE = 4
"""Searches in a row without the leader before it is lost: two seconds."""

OUTLIERS_TO_JUMP = 4
"""Searches in a row that find the follower beside another place of the path before the offset jumps there."""

FRESH_US = 2_000_000
"""A vehicle whose newest message is older than this, relative to the follower's, cannot be its leader."""

PAIRING = np.dtype(
    [
        ("generation", "i8"),  # of the follower's track when this row was initialised
        ("leader_row", "i8"),  # NO_LEADER: none; read it through `leader_of`
        ("leader_generation", "i8"),
        ("candidate_row", "i8"),
        ("confirmations", "i8"),
        ("coasts", "i8"),
        ("offset_outliers", "i8"),  # searches in a row that found another place of the path
        ("search_us", "i8"),  # event time of the last search
        ("phase_us", "i8"),  # spreads the searches of many vehicles over time
        ("search_x_m", "f8"),  # follower's base at the last search that moved the offset
        ("offset_m", "f8"),
    ],
    align=True,
)

_KEEP_CORRIDOR = 1.5  # width of the corridor that keeps a leader, relative to the one that finds it
_GONE_LANES = 0.75  # a lane reference this far beside the path of the second vehicle has left the lane
_DECLARED_CORRIDOR_M = 15.0  # error of the worst receivers
_ALLOWANCE_LANES = 1.0 / 6.0  # bound on the allowance for the declared accuracies: excludes the next lane
_OFFSET_GAIN = 0.5  # share of the error that one search corrects, so that noise of both receivers averages out
_OFFSET_PER_METRE = 0.15  # two paths a metre apart in a bend of 7 m radius
_OFFSET_SLACK_M = 0.02  # change allowed at standstill
_OUTLIER_LIMITS, _OUTLIER_MIN_M = 4.0, 1.0  # beyond both, the error shows another place of the path


def new_pairing(capacity: int) -> Records:
    """Return `capacity` rows of dtype PAIRING, all without a leader."""
    pairing = np.zeros(capacity, PAIRING)
    pairing["leader_row"] = pairing["candidate_row"] = NO_LEADER
    return pairing


@njit(cache=True, error_model="numpy")
def leader_of(tracks: Records, pairing: Records, row: int) -> int:
    """Return the row of the leader of `row`, or NO_LEADER, also if either row has another generation since."""
    pair = pairing[row]
    leader_row: int = pair.leader_row
    if leader_row == NO_LEADER or pair.generation != tracks[row].generation:
        return NO_LEADER
    leader = tracks[leader_row]
    return leader_row if not is_free(leader) and leader.generation == pair.leader_generation else NO_LEADER


@njit(cache=True, error_model="numpy")
def find_leaders(
    tracks: Records,
    pairing: Records,
    grid: Grid,
    rows: I64,
    declared_rows: I64,
    now_us: int,
    range_m: float,
    lane_width_m: float,
    out_changed: NDArray[np.bool_],
) -> int:
    """Search the leaders of those of `rows` (n,) that are due; return how many changed.

    Call it after `extend_path_history`. `declared_rows` (n,) are the rows of the leaders that senders declare, or
    NO_LEADER. `now_us` is the time of the call on any clock. `out_changed` (n,) is whether the leader changed, or its
    place by more than the offset may move.
    """
    if now_us // REBUILD_US != grid.built_us[0] // REBUILD_US:
        build(grid, tracks, range_m, now_us)
    nearby = np.empty(NEAREST, np.int64)
    apart_squared = np.empty(NEAREST)
    changes = 0
    for i in range(rows.size):
        row = rows[i]
        out_changed[i] = False
        track, pair = tracks[row], pairing[row]
        if not _search_due(pair, track):
            continue
        pair.search_us = track.t_us
        near_count = find_near(grid, track, row, range_m, nearby, apart_squared)
        observe_overlap(tracks, row, nearby, apart_squared, near_count)
        out_changed[i] = _find_leader(
            tracks, pairing, row, declared_rows[i], nearby[:near_count], range_m, lane_width_m
        )
        changes += out_changed[i]
    return changes


@njit(cache=True, error_model="numpy")
def searches_due(tracks: Records, pairing: Records, rows: I64) -> I64:
    """Return the places of those of `rows` (n,) whose search for the leader is due."""
    places, count = np.empty(rows.size, np.int64), 0
    for i in range(rows.size):
        if _search_due(pairing[rows[i]], tracks[rows[i]]):
            places[count] = i
            count += 1
    return places[:count]


@njit(cache=True, error_model="numpy")
def _search_due(pair: Any, track: Any) -> bool:
    if pair.generation != track.generation:
        _initialise(pair, track)
    return bool(track.t_us - pair.search_us >= SEARCH_EVERY_US - 33_000 + pair.phase_us)


@njit(cache=True, error_model="numpy")
def leaders_of(tracks: Records, pairing: Records, rows: I64, out_leaders: I64) -> None:
    """Write `leader_of` each of `rows`."""
    for i in range(rows.size):
        out_leaders[i] = leader_of(tracks, pairing, rows[i])


@njit(cache=True, error_model="numpy")
def gaps_m(tracks: Records, pairing: Records, rows: I64, out_gap_m: F64) -> None:
    """Write the distance along the road from each row's front to its leader's rear, m; NaN without a leader."""
    for i in range(rows.size):
        leader_row = leader_of(tracks, pairing, rows[i])
        out_gap_m[i] = np.nan
        if leader_row != NO_LEADER:
            leader = tracks[leader_row]
            out_gap_m[i] = leader.x_m + pairing[rows[i]].offset_m - tracks[rows[i]].x_m - leader.length_m


@njit(cache=True, error_model="numpy")
def _initialise(pair: Any, track: Any) -> None:
    """Initialise a row without a leader; its first search is due within half a second."""
    pair.generation = track.generation
    pair.leader_row = pair.candidate_row = NO_LEADER
    pair.confirmations = pair.coasts = pair.offset_outliers = 0
    pair.phase_us = _phase_us(track)
    pair.search_us = track.t_us - 7 * pair.phase_us


@njit(cache=True, error_model="numpy")
def _phase_us(track: Any) -> int:
    """Return 0 to 66 ms by a hash of the track's event time and position, so the row number has no effect."""
    lat, lon = int(track.lat_deg * 1e7), int(track.lon_deg * 1e7)
    mixed = (track.t_us * 7919) ^ (lat * 73_856_093) ^ (lon * 19_349_663)
    return int(mixed >> 12 & 0xFFFF)


@njit(cache=True, error_model="numpy")
def _find_leader(
    tracks: Records, pairing: Records, row: int, declared_row: int, nearby: I64, range_m: float, lane_width_m: float
) -> bool:
    """Update the leader and the offset of one row; return whether either jumped."""
    follower, pair = tracks[row], pairing[row]
    leader_row = leader_of(tracks, pairing, row)
    changed = bool(leader_row != pair.leader_row)
    pair.leader_row = leader_row

    found_row, ahead_m = _search_declared(tracks, row, declared_row, range_m)
    declared = found_row != NO_LEADER
    if not declared:
        found_row, ahead_m = _search_lane(tracks, row, leader_row, nearby, range_m, lane_width_m)
    if found_row != NO_LEADER and found_row == leader_row:
        pair.coasts = pair.confirmations = 0
        pair.candidate_row = NO_LEADER
        return _update_offset(pair, follower, follower.base_x_m + ahead_m - tracks[leader_row].base_x_m)

    leader_ahead_m = 0.0
    if leader_row != NO_LEADER:
        leader = tracks[leader_row]
        if _is_fresh(leader, follower):
            leader_ahead_m, _ = distance_along_path(leader, follower, 0.5 * lane_width_m * _KEEP_CORRIDOR, range_m)
        pair.coasts = 0 if leader_ahead_m > 0.0 else pair.coasts + 1
    pair.confirmations = pair.confirmations + 1 if found_row == pair.candidate_row else 1
    pair.candidate_row = found_row
    needed = CONFIRMATIONS_TO_ACQUIRE if leader_row == NO_LEADER else CONFIRMATIONS_TO_REPLACE
    if found_row != NO_LEADER and (declared or pair.confirmations >= needed):
        pair.leader_row = found_row
        pair.leader_generation = tracks[found_row].generation
        pair.offset_m = follower.base_x_m + ahead_m - tracks[found_row].base_x_m
        pair.search_x_m = follower.base_x_m
        pair.candidate_row = NO_LEADER
        pair.confirmations = pair.coasts = pair.offset_outliers = 0
        return True
    if leader_ahead_m > 0.0:
        return _update_offset(pair, follower, follower.base_x_m + leader_ahead_m - leader.base_x_m)
    if pair.coasts >= COASTS_TO_LOSE:
        pair.leader_row = NO_LEADER
        pair.coasts = 0
        return True
    return changed


@njit(cache=True, error_model="numpy")
def _update_offset(pair: Any, follower: Any, measured_m: float) -> bool:
    """Move the offset towards the measured one within its limits; return whether it jumped."""
    limit_m = _OFFSET_SLACK_M + _OFFSET_PER_METRE * abs(follower.base_x_m - pair.search_x_m)
    pair.search_x_m = follower.base_x_m
    error_m = measured_m - pair.offset_m
    if abs(error_m) > max(_OUTLIER_LIMITS * limit_m, _OUTLIER_MIN_M):
        pair.offset_outliers += 1
        if pair.offset_outliers < OUTLIERS_TO_JUMP:
            return False
        pair.offset_outliers = 0
        pair.offset_m = measured_m
        return True
    pair.offset_outliers = 0
    pair.offset_m += min(max(_OFFSET_GAIN * error_m, -limit_m), limit_m)
    return False


@njit(cache=True, error_model="numpy")
def _search_declared(tracks: Records, row: int, declared_row: int, range_m: float) -> tuple[int, float]:
    """Return (row, metres ahead) of the declared leader, or NO_LEADER if it is not acceptable."""
    if declared_row in (NO_LEADER, row):
        return NO_LEADER, 0.0
    follower, leader = tracks[row], tracks[declared_row]
    if is_free(leader) or not _is_fresh(leader, follower):
        return NO_LEADER, 0.0
    ahead_m, _ = distance_along_path(leader, follower, _DECLARED_CORRIDOR_M, range_m)
    return (declared_row, ahead_m) if ahead_m > 0.0 else (NO_LEADER, 0.0)


@njit(cache=True, error_model="numpy")
def _search_lane(
    tracks: Records, row: int, leader_row: int, nearby: I64, range_m: float, lane_width_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the vehicle next ahead in the follower's lane, or NO_LEADER.

    `nearby` is sorted by straight distance, a lower bound of the distance along the road.
    """
    follower = tracks[row]
    half_lane_m = 0.5 * lane_width_m
    first_row, first_m = NO_LEADER, np.inf
    second_row, second_m = NO_LEADER, np.inf
    for k in range(-1, nearby.size):
        near_row = leader_row if k < 0 else nearby[k]
        if near_row == NO_LEADER or (k >= 0 and near_row == leader_row):
            continue
        near = tracks[near_row]
        if is_free(near) or not _is_fresh(near, follower):
            continue
        corridor_m = half_lane_m * _KEEP_CORRIDOR
        if near_row != leader_row:
            corridor_m = half_lane_m + _allowance_m(near, follower, lane_width_m)
        ahead_m, _ = distance_along_path(near, follower, corridor_m, range_m)
        if ahead_m <= 0.0:
            continue
        if ahead_m < first_m:
            second_row, second_m = first_row, first_m
            first_row, first_m = near_row, ahead_m
        elif ahead_m < second_m:
            second_row, second_m = near_row, ahead_m
        if second_row != NO_LEADER and k >= 0:
            break
    if first_row == NO_LEADER:
        return NO_LEADER, 0.0
    if second_row != NO_LEADER:
        behind_m, lateral_m = distance_along_path(tracks[second_row], tracks[first_row], 2.0 * lane_width_m, range_m)
        if behind_m > 0.0 and abs(lateral_m) > _GONE_LANES * lane_width_m:
            first_row, first_m = second_row, second_m
    return _find_cut_in(tracks, row, leader_row, first_row, first_m, nearby, half_lane_m)


@njit(cache=True, error_model="numpy")
def _find_cut_in(
    tracks: Records, row: int, leader_row: int, reference_row: int, reference_m: float, nearby: I64, half_lane_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the nearest vehicle on the lane reference's path, or of the reference."""
    follower, lane_reference = tracks[row], tracks[reference_row]
    found_row, found_m = reference_row, reference_m
    for k in range(nearby.size):
        near = tracks[nearby[k]]
        if nearby[k] == reference_row or is_free(near) or not _is_fresh(near, follower):
            continue
        east_m, north_m = between_bases(near, follower)
        if math.hypot(east_m, north_m) >= found_m:
            continue
        corridor_m = half_lane_m * (_KEEP_CORRIDOR if nearby[k] == leader_row else 1.0)
        behind_m, _ = distance_along_path(lane_reference, near, corridor_m, reference_m)
        if behind_m > 0.0 and 0.0 < reference_m - behind_m < found_m:
            found_row, found_m = nearby[k], reference_m - behind_m
    return found_row, found_m


@njit(cache=True, error_model="numpy")
def _is_fresh(vehicle: Any, follower: Any) -> bool:
    """Whether the newest messages of both have about the same event time."""
    return bool(abs(vehicle.t_us - follower.t_us) <= FRESH_US)


@njit(cache=True, error_model="numpy")
def _allowance_m(vehicle: Any, follower: Any, lane_width_m: float) -> float:
    """Return the allowance on the half lane for the accuracies that the two declare, m."""
    declared_m = math.hypot(vehicle.accuracy_m, follower.accuracy_m)
    return min(declared_m, _ALLOWANCE_LANES * lane_width_m) if math.isfinite(declared_m) else 0.0
