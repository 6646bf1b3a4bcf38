"""Who follows whom, and where the leader is on the follower's own odometer.

**In one lane.** The car ahead has been where the follower is now: its trail passes beside the follower, within half a
lane and in the same direction. Measured along that trail, curves and turns at a crossing are distances like any other,
and the neighbouring lane, the opposite one and a crossing road are told apart where it counts. A trail too young to
reach back to the follower is continued straight from its oldest end.

**Leader.** Of all vehicles whose trail passes beside the follower the nearest is its witness of the lane. A vehicle
between the two that now lies on the witness's trail has cut in, and is the leader. When the next witness's trail has
the nearest one beside it, a lane away, that one has left, and the next takes its place. A vehicle that names its leader
is believed if that vehicle is known, fresh, and ahead within range.

**Hysteresis.** Rows are looked at about twice a second of event time. A challenger must be the answer of several looks
in a row; a leader is kept in a wider corridor, and lost after several looks without it.

**Offset.** `offset_m` takes the leader's odometer into the follower's: x_leader + offset_m. It is the follower's
odometer less the leader's odometer at the place on its trail abreast of the follower. Both places are bases of
`tracks`, so that a bad position of either never enters, and an error along the road cancels. The two paths may differ
in length only by as much as they are long: the offset never moves faster than a share of the way travelled.
"""

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.path_history import between_bases, distance_along_path
from headway.core.tracking.spatial_index import NEAREST, REBUILD_US, Grid, build, find_near
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

NO_LEADER = -1
"""Row of a leader that is not there."""

SEARCH_EVERY_US = 500_000
CONFIRMATIONS_TO_ACQUIRE = 2
"""Looks in a row before a vehicle becomes the leader of one that has none."""

CONFIRMATIONS_TO_REPLACE = 3
"""Looks in a row before a challenger replaces a leader that is still in the lane."""

COASTS_TO_LOSE = 4
"""Looks in a row without the leader before it is lost: two seconds."""

OUTLIERS_TO_JUMP = 4
"""Looks in a row that find the follower beside another place of the trail before the offset leaps there."""

FRESH_US = 2_000_000
"""A vehicle not heard for so long cannot be anybody's leader at this look."""

PAIRING = np.dtype(
    [
        ("generation", "i8"),  # of the follower's track when this row was begun
        ("leader_row", "i8"),  # NO_LEADER: none; read it through `leader_of`
        ("leader_generation", "i8"),
        ("candidate_row", "i8"),
        ("confirmations", "i8"),
        ("coasts", "i8"),
        ("offset_outliers", "i8"),  # looks in a row that found the follower beside another place of the trail
        ("search_us", "i8"),  # event time of the last look
        ("search_x_m", "f8"),  # follower's base at the last look that moved the offset
        ("offset_m", "f8"),
    ],
    align=True,
)

_KEEP_CORRIDOR = 1.5  # of the corridor that makes a leader, the one that keeps it
_GONE_LANES = 0.75  # a witness so far beside the next one's trail has left the lane
_DECLARED_CORRIDOR_M = 15.0  # what the worst receivers are off by
_ALLOWANCE_LANES = 1.0 / 6.0  # at most, for the accuracy that both declare: the next lane must stay out
_OFFSET_GAIN = 0.5
_OFFSET_PER_METRE = 0.15  # two paths a metre apart in a bend of 7 m radius
_OFFSET_SLACK_M = 0.02
_OUTLIER_LIMITS, _OUTLIER_MIN_M = 4.0, 1.0  # an error beyond both is not two paths parting, but another place


def new_pairing(capacity: int) -> Records:
    """Return `capacity` rows of dtype PAIRING, all without a leader."""
    pairing = np.zeros(capacity, PAIRING)
    pairing["leader_row"] = pairing["candidate_row"] = NO_LEADER
    return pairing


@njit(cache=True)
def leader_of(tracks: Records, pairing: Records, row: int) -> int:
    """Return the row of the vehicle that `row` follows, or NO_LEADER: also when either row has changed hands since."""
    pair = pairing[row]
    leader_row: int = pair.leader_row
    if leader_row == NO_LEADER or pair.generation != tracks[row].generation:
        return NO_LEADER
    leader = tracks[leader_row]
    return leader_row if leader.t_us != 0 and leader.generation == pair.leader_generation else NO_LEADER


@njit(cache=True)
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
    """Look who is ahead of those of `rows` that are due; return how many leaders changed.

    Call it after `extend_path_history`, with the rows of any readings: a row that is not due costs a comparison.
    `declared_rows` (B,): the row of the leader that each vehicle declares, or NO_LEADER. `now_us`: any clock that the
    readings of one call share. `out_changed` (B,): whether the leader, or its place by more than the offset may move,
    is another than before, so that the filter of that row should not expect the two to continue.
    """
    if not 0 <= now_us - grid.built_us[0] < REBUILD_US:
        build(grid, tracks, range_m, now_us)
    nearby = np.empty(NEAREST, np.int64)
    apart_squared = np.empty(NEAREST)
    changes = 0
    for i in range(rows.size):
        row = rows[i]
        out_changed[i] = False
        track, pair = tracks[row], pairing[row]
        if pair.generation != track.generation:
            _initialise(pair, track, row)
        if track.t_us - pair.search_us < SEARCH_EVERY_US - 33_000 + _spread_us(row):
            continue
        pair.search_us = track.t_us
        near_count = find_near(grid, track, row, range_m, nearby, apart_squared)
        out_changed[i] = _find_leader(
            tracks, pairing, row, declared_rows[i], nearby[:near_count], range_m, lane_width_m
        )
        changes += out_changed[i]
    return changes


@njit(cache=True)
def leaders_of(tracks: Records, pairing: Records, rows: I64, out_leaders: I64) -> None:
    """Write `leader_of` each of `rows`."""
    for i in range(rows.size):
        out_leaders[i] = leader_of(tracks, pairing, rows[i])


@njit(cache=True)
def gaps_m(tracks: Records, pairing: Records, rows: I64, out_gap_m: F64) -> None:
    """Write the distance along the road from each row's front to its leader's rear, m; NaN where it follows nobody."""
    for i in range(rows.size):
        leader_row = leader_of(tracks, pairing, rows[i])
        out_gap_m[i] = np.nan
        if leader_row != NO_LEADER:
            leader = tracks[leader_row]
            out_gap_m[i] = leader.x_m + pairing[rows[i]].offset_m - tracks[rows[i]].x_m - leader.length_m


@njit(cache=True)
def _initialise(pair: Any, track: Any, row: int) -> None:
    """Start a row without a leader, its first look up to half a second away."""
    pair.generation = track.generation
    pair.leader_row = pair.candidate_row = NO_LEADER
    pair.confirmations = pair.coasts = pair.offset_outliers = 0
    pair.search_us = track.t_us - 7 * _spread_us(row)


@njit(cache=True)
def _spread_us(row: int) -> int:
    """Return 0 to 66 ms, another for every row, so that looks do not fall together."""
    return row * 7919 % 65_536


@njit(cache=True)
def _find_leader(
    tracks: Records, pairing: Records, row: int, declared_row: int, nearby: I64, range_m: float, lane_width_m: float
) -> bool:
    """Bring one row's leader and offset up to date; return whether either leapt."""
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
    needed = CONFIRMATIONS_TO_REPLACE if leader_ahead_m > 0.0 else CONFIRMATIONS_TO_ACQUIRE
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


@njit(cache=True)
def _update_offset(pair: Any, follower: Any, measured_m: float) -> bool:
    """Move the offset towards the one measured, no faster than two paths may part; return whether it leapt."""
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


@njit(cache=True)
def _search_declared(tracks: Records, row: int, declared_row: int, range_m: float) -> tuple[int, float]:
    """Return (row, metres ahead) of the leader the follower names, or NO_LEADER where it cannot be."""
    if declared_row in (NO_LEADER, row):
        return NO_LEADER, 0.0
    follower, leader = tracks[row], tracks[declared_row]
    if leader.t_us == 0 or not _is_fresh(leader, follower):
        return NO_LEADER, 0.0
    ahead_m, _ = distance_along_path(leader, follower, _DECLARED_CORRIDOR_M, range_m)
    return (declared_row, ahead_m) if ahead_m > 0.0 else (NO_LEADER, 0.0)


@njit(cache=True)
def _search_lane(
    tracks: Records, row: int, leader_row: int, nearby: I64, range_m: float, lane_width_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the vehicle next ahead in the follower's lane, or NO_LEADER.

    `nearby` is sorted by distance as the crow flies, which no way along a road undercuts.
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
        if near.t_us == 0 or not _is_fresh(near, follower):
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


@njit(cache=True)
def _find_cut_in(
    tracks: Records, row: int, leader_row: int, reference_row: int, reference_m: float, nearby: I64, half_lane_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the nearest vehicle on the witness's trail between the two, else of the witness."""
    follower, lane_reference = tracks[row], tracks[reference_row]
    found_row, found_m = reference_row, reference_m
    for k in range(nearby.size):
        near = tracks[nearby[k]]
        if nearby[k] == reference_row or near.t_us == 0 or not _is_fresh(near, follower):
            continue
        east_m, north_m = between_bases(near, follower)
        if math.hypot(east_m, north_m) >= found_m:
            continue
        corridor_m = half_lane_m * (_KEEP_CORRIDOR if nearby[k] == leader_row else 1.0)
        behind_m, _ = distance_along_path(lane_reference, near, corridor_m, reference_m)
        if behind_m > 0.0 and 0.0 < reference_m - behind_m < found_m:
            found_row, found_m = nearby[k], reference_m - behind_m
    return found_row, found_m


@njit(cache=True)
def _is_fresh(vehicle: Any, follower: Any) -> bool:
    """Whether both were heard at about the same time."""
    return bool(abs(vehicle.t_us - follower.t_us) <= FRESH_US)


@njit(cache=True)
def _allowance_m(vehicle: Any, follower: Any, lane_width_m: float) -> float:
    """How much wider than half a lane the corridor is, for the accuracy that the two declare."""
    declared_m = math.hypot(vehicle.accuracy_m, follower.accuracy_m)
    return min(declared_m, _ALLOWANCE_LANES * lane_width_m) if math.isfinite(declared_m) else 0.0
