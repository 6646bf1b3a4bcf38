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

from headway.core.tracking.path_history import ahead_on_trail, between_bases
from headway.core.tracking.spatial_index import NEAREST, REBUILD_US, Grid, build, find_near
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

NOBODY = -1
"""Row of a leader that is not there."""

LOOK_EVERY_US = 500_000
VOTES_TO_LEAD = 2
"""Looks in a row before a vehicle becomes the leader of one that has none."""

VOTES_TO_REPLACE = 3
"""Looks in a row before a challenger replaces a leader that is still in the lane."""

MISSES_TO_LOSE = 4
"""Looks in a row without the leader before it is lost: two seconds."""

DOUBTS_TO_LEAP = 4
"""Looks in a row that find the follower beside another place of the trail before the offset leaps there."""

FRESH_US = 2_000_000
"""A vehicle not heard for so long cannot be anybody's leader at this look."""

PAIRING = np.dtype(
    [
        ("generation", "i8"),  # of the follower's track when this row was begun
        ("leader_row", "i8"),  # NOBODY: none; read it through `leader_of`
        ("leader_generation", "i8"),
        ("challenger_row", "i8"),
        ("votes", "i8"),
        ("misses", "i8"),
        ("doubts", "i8"),  # looks in a row that found the follower beside another place of the trail
        ("look_us", "i8"),  # event time of the last look
        ("look_x_m", "f8"),  # follower's base at the last look that moved the offset
        ("offset_m", "f8"),
    ],
    align=True,
)

_KEEP_CORRIDOR = 1.5  # of the corridor that makes a leader, the one that keeps it
_GONE_LANES = 0.75  # a witness so far beside the next one's trail has left the lane
_DECLARED_REACH_M = 15.0  # what the worst receivers are off by
_ALLOWANCE_LANES = 1.0 / 6.0  # at most, for the accuracy that both declare: the next lane must stay out
_OFFSET_GAIN = 0.5
_OFFSET_PER_METRE = 0.15  # two paths a metre apart in a bend of 7 m radius
_OFFSET_SLACK_M = 0.02
_DOUBT_LIMITS, _DOUBT_MIN_M = 4.0, 1.0  # an error beyond both is not two paths parting, but another place


def new_pairing(capacity: int) -> Records:
    """Return `capacity` rows of dtype PAIRING, all without a leader."""
    pairing = np.zeros(capacity, PAIRING)
    pairing["leader_row"] = pairing["challenger_row"] = NOBODY
    return pairing


@njit(cache=True)
def leader_of(tracks: Records, pairing: Records, row: int) -> int:
    """Return the row of the vehicle that `row` follows, or NOBODY: also when either row has changed hands since."""
    pair = pairing[row]
    leader_row: int = pair.leader_row
    if leader_row == NOBODY or pair.generation != tracks[row].generation:
        return NOBODY
    leader = tracks[leader_row]
    return leader_row if leader.t_us != 0 and leader.generation == pair.leader_generation else NOBODY


@njit(cache=True)
def look(
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

    Call it after `leave_crumb`, with the rows of any readings: a row that is not due costs a comparison.
    `declared_rows` (B,): the row of the vehicle that each names as its leader, or NOBODY. `now_us`: any clock that the
    readings of one call share. `out_changed` (B,): whether the leader, or its place by more than the offset may move,
    is another than before, so that the filter of that row should not expect the two to continue.
    """
    if not 0 <= now_us - grid.built_us[0] < REBUILD_US:
        build(grid, tracks, range_m, now_us)
    near = np.empty(NEAREST, np.int64)
    apart_squared = np.empty(NEAREST)
    changes = 0
    for i in range(rows.size):
        row = rows[i]
        out_changed[i] = False
        track, pair = tracks[row], pairing[row]
        if pair.generation != track.generation:
            _begin(pair, track, row)
        if track.t_us - pair.look_us < LOOK_EVERY_US - 33_000 + _spread_us(row):
            continue
        pair.look_us = track.t_us
        near_count = find_near(grid, track, row, range_m, near, apart_squared)
        out_changed[i] = _look_once(tracks, pairing, row, declared_rows[i], near[:near_count], range_m, lane_width_m)
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
        if leader_row != NOBODY:
            leader = tracks[leader_row]
            out_gap_m[i] = leader.x_m + pairing[rows[i]].offset_m - tracks[rows[i]].x_m - leader.length_m


@njit(cache=True)
def _begin(pair: Any, track: Any, row: int) -> None:
    """Start a row without a leader, its first look up to half a second away."""
    pair.generation = track.generation
    pair.leader_row = pair.challenger_row = NOBODY
    pair.votes = pair.misses = pair.doubts = 0
    pair.look_us = track.t_us - 7 * _spread_us(row)


@njit(cache=True)
def _spread_us(row: int) -> int:
    """Return 0 to 66 ms, another for every row, so that looks do not fall together."""
    return row * 7919 % 65_536


@njit(cache=True)
def _look_once(
    tracks: Records, pairing: Records, row: int, declared_row: int, near: I64, range_m: float, lane_width_m: float
) -> bool:
    """Bring one row's leader and offset up to date; return whether either leapt."""
    follower, pair = tracks[row], pairing[row]
    leader_row = leader_of(tracks, pairing, row)
    changed = bool(leader_row != pair.leader_row)
    pair.leader_row = leader_row

    found_row, ahead_m = _find_declared(tracks, row, declared_row, range_m)
    declared = found_row != NOBODY
    if not declared:
        found_row, ahead_m = _find_leader(tracks, row, leader_row, near, range_m, lane_width_m)
    if found_row != NOBODY and found_row == leader_row:
        pair.misses = pair.votes = 0
        pair.challenger_row = NOBODY
        return _follow_offset(pair, follower, follower.base_x_m + ahead_m - tracks[leader_row].base_x_m)

    leader_ahead_m = 0.0
    if leader_row != NOBODY:
        leader = tracks[leader_row]
        if _is_fresh(leader, follower):
            leader_ahead_m, _ = ahead_on_trail(leader, follower, 0.5 * lane_width_m * _KEEP_CORRIDOR, range_m)
        pair.misses = 0 if leader_ahead_m > 0.0 else pair.misses + 1
    pair.votes = pair.votes + 1 if found_row == pair.challenger_row else 1
    pair.challenger_row = found_row
    votes_needed = VOTES_TO_REPLACE if leader_ahead_m > 0.0 else VOTES_TO_LEAD
    if found_row != NOBODY and (declared or pair.votes >= votes_needed):
        pair.leader_row = found_row
        pair.leader_generation = tracks[found_row].generation
        pair.offset_m = follower.base_x_m + ahead_m - tracks[found_row].base_x_m
        pair.look_x_m = follower.base_x_m
        pair.challenger_row = NOBODY
        pair.votes = pair.misses = pair.doubts = 0
        return True
    if leader_ahead_m > 0.0:
        return _follow_offset(pair, follower, follower.base_x_m + leader_ahead_m - leader.base_x_m)
    if pair.misses >= MISSES_TO_LOSE:
        pair.leader_row = NOBODY
        pair.misses = 0
        return True
    return changed


@njit(cache=True)
def _follow_offset(pair: Any, follower: Any, measured_m: float) -> bool:
    """Move the offset towards the one measured, no faster than two paths may part; return whether it leapt."""
    limit_m = _OFFSET_SLACK_M + _OFFSET_PER_METRE * abs(follower.base_x_m - pair.look_x_m)
    pair.look_x_m = follower.base_x_m
    error_m = measured_m - pair.offset_m
    if abs(error_m) > max(_DOUBT_LIMITS * limit_m, _DOUBT_MIN_M):
        pair.doubts += 1
        if pair.doubts < DOUBTS_TO_LEAP:
            return False
        pair.doubts = 0
        pair.offset_m = measured_m
        return True
    pair.doubts = 0
    pair.offset_m += min(max(_OFFSET_GAIN * error_m, -limit_m), limit_m)
    return False


@njit(cache=True)
def _find_declared(tracks: Records, row: int, declared_row: int, range_m: float) -> tuple[int, float]:
    """Return (row, metres ahead) of the leader the follower names, or NOBODY where it cannot be."""
    if declared_row in (NOBODY, row):
        return NOBODY, 0.0
    follower, leader = tracks[row], tracks[declared_row]
    if leader.t_us == 0 or not _is_fresh(leader, follower):
        return NOBODY, 0.0
    ahead_m, _ = ahead_on_trail(leader, follower, _DECLARED_REACH_M, range_m)
    return (declared_row, ahead_m) if ahead_m > 0.0 else (NOBODY, 0.0)


@njit(cache=True)
def _find_leader(
    tracks: Records, row: int, leader_row: int, near: I64, range_m: float, lane_width_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the vehicle next ahead in the follower's lane, or NOBODY.

    `near` is sorted by distance as the crow flies, which no way along a road undercuts.
    """
    follower = tracks[row]
    corridor_m = 0.5 * lane_width_m
    first_row, first_m = NOBODY, np.inf
    second_row, second_m = NOBODY, np.inf
    for k in range(-1, near.size):
        candidate_row = leader_row if k < 0 else near[k]
        if candidate_row == NOBODY or (k >= 0 and candidate_row == leader_row):
            continue
        candidate = tracks[candidate_row]
        if candidate.t_us == 0 or not _is_fresh(candidate, follower):
            continue
        reach_m = corridor_m * _KEEP_CORRIDOR
        if candidate_row != leader_row:
            reach_m = corridor_m + _allowance_m(candidate, follower, lane_width_m)
        ahead_m, _ = ahead_on_trail(candidate, follower, reach_m, range_m)
        if ahead_m <= 0.0:
            continue
        if ahead_m < first_m:
            second_row, second_m = first_row, first_m
            first_row, first_m = candidate_row, ahead_m
        elif ahead_m < second_m:
            second_row, second_m = candidate_row, ahead_m
        if second_row != NOBODY and k >= 0:
            break
    if first_row == NOBODY:
        return NOBODY, 0.0
    if second_row != NOBODY:
        behind_m, lateral_m = ahead_on_trail(tracks[second_row], tracks[first_row], 2.0 * lane_width_m, range_m)
        if behind_m > 0.0 and abs(lateral_m) > _GONE_LANES * lane_width_m:
            first_row, first_m = second_row, second_m
    return _find_cut_in(tracks, row, leader_row, first_row, first_m, near, corridor_m)


@njit(cache=True)
def _find_cut_in(
    tracks: Records, row: int, leader_row: int, witness_row: int, witness_m: float, near: I64, corridor_m: float
) -> tuple[int, float]:
    """Return (row, metres ahead) of the nearest vehicle on the witness's trail between the two, else of the witness."""
    follower, witness = tracks[row], tracks[witness_row]
    found_row, found_m = witness_row, witness_m
    for k in range(near.size):
        candidate = tracks[near[k]]
        if near[k] == witness_row or candidate.t_us == 0 or not _is_fresh(candidate, follower):
            continue
        east_m, north_m = between_bases(candidate, follower)
        if math.hypot(east_m, north_m) >= found_m:
            continue
        reach_m = corridor_m * (_KEEP_CORRIDOR if near[k] == leader_row else 1.0)
        behind_m, _ = ahead_on_trail(witness, candidate, reach_m, witness_m)
        if behind_m > 0.0 and 0.0 < witness_m - behind_m < found_m:
            found_row, found_m = near[k], witness_m - behind_m
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
