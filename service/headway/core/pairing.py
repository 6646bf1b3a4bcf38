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
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.batch import I64
from headway.core.geometry import displacement_m, metres_per_degree, wrap_degrees
from headway.core.records import Records
from headway.core.tracks import CRUMB_SPACING_M, CRUMBS, EAST, NORTH, X

NOBODY = -1
"""Row of a leader that is not there."""

LOOK_EVERY_US = 500_000
VOTES_TO_LEAD = 2
"""Looks in a row before a vehicle becomes the leader of one that has none."""

VOTES_TO_REPLACE = 3
"""Looks in a row before a challenger replaces a leader that is still in the lane."""

MISSES_TO_LOSE = 4
"""Looks in a row without the leader before it is lost: two seconds."""

FRESH_US = 2_000_000
"""A vehicle not heard for so long cannot be anybody's leader at this look."""

PAIRING = np.dtype(
    [
        ("serial", "i8"),  # of the follower's track when this row was begun
        ("leader_row", "i8"),  # NOBODY: none; read it through `leader_of`
        ("leader_serial", "i8"),
        ("challenger_row", "i8"),
        ("votes", "i8"),
        ("misses", "i8"),
        ("doubts", "i8"),  # looks in a row in which the offset disagreed with the trail by more than it may move
        ("look_us", "i8"),  # event time of the last look
        ("look_x_m", "f8"),  # follower's base at the last look that moved the offset
        ("offset_m", "f8"),
        ("lateral_m", "f8"),  # follower, to the left of the leader's trail
        ("declared", "?"),  # the follower itself names this leader
    ],
    align=True,
)

_ENTRY = np.dtype(
    [
        ("row", "i8"),
        ("t_us", "i8"),
        ("lat_deg", "f8"),
        ("lon_deg", "f8"),
        ("v_mps", "f8"),
        ("heading_east", "f8"),
        ("heading_north", "f8"),
        ("bucket", "i8"),
    ],
    align=True,
)


class Grid(NamedTuple):
    """Who is near: vehicles sorted by the cell they were in at `built_us`. Holds nothing that cannot be built again."""

    entries: Records
    unsorted: Records
    bucket_start: I64
    built_us: I64


_REBUILD_US = 250_000
_NEAREST = 12  # candidates looked at closely
_SCAN_PER_CELL = 256  # of a cell with more, an even share is looked at, whatever gathers there
_KEEP_CORRIDOR = 1.5  # of the corridor that makes a leader, the one that keeps it
_GONE_LANES = 0.75  # a witness so far beside the next one's trail has left the lane
_DECLARED_REACH_M = 15.0  # what the worst receivers are off by
_ALLOWANCE_LANES = 1.0 / 6.0  # at most, for the accuracy that both declare: the next lane must stay out
_TRAIL_COS_MIN = 0.77  # 40 degrees: a base lags its car by up to one spacing of a tight turn
_STRAIGHT_COS_MIN = 0.97  # 14 degrees, where the trail is continued straight
_ONCOMING_COS = -0.5
_BASELINE = 2  # crumbs to either side that give a trail its direction
_OFFSET_GAIN = 0.5
_OFFSET_PER_METRE = 0.15  # two paths a metre apart in a bend of 7 m radius
_OFFSET_SLACK_M = 0.02
_DOUBTS_TO_RESET = 4
_METRES_PER_DEGREE_MIN = 110_574.0  # of latitude, at the equator
_METRES_PER_DEGREE_EQUATOR = 111_319.0  # of longitude


def new_pairing(capacity: int) -> Records:
    """Return `capacity` rows of dtype PAIRING, all without a leader."""
    pairing = np.zeros(capacity, PAIRING)
    pairing["leader_row"] = pairing["challenger_row"] = NOBODY
    return pairing


def new_grid(capacity: int) -> Grid:
    """Return an empty index for `capacity` vehicles."""
    buckets = 1 << max(4, (2 * capacity - 1).bit_length())
    return Grid(
        np.zeros(capacity, _ENTRY),
        np.zeros(capacity, _ENTRY),
        np.zeros(buckets + 1, np.int64),
        np.full(1, -_REBUILD_US, np.int64),
    )


@njit(cache=True)
def leader_of(tracks: Records, pairing: Records, row: int) -> int:
    """Return the row of the vehicle that `row` follows, or NOBODY: also when either row has changed hands since."""
    pair = pairing[row]
    leader_row: int = pair.leader_row
    if leader_row == NOBODY or pair.serial != tracks[row].serial:
        return NOBODY
    leader = tracks[leader_row]
    return leader_row if leader.t_us != 0 and leader.serial == pair.leader_serial else NOBODY


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
    if not 0 <= now_us - grid.built_us[0] < _REBUILD_US:
        _build(grid, tracks, range_m, now_us)
    near = np.empty(_NEAREST, np.int64)
    apart_squared = np.empty(_NEAREST)
    changes = 0
    for i in range(rows.size):
        row = rows[i]
        out_changed[i] = False
        track, pair = tracks[row], pairing[row]
        if pair.serial != track.serial:
            _begin(pair, track, row)
        if track.t_us - pair.look_us < LOOK_EVERY_US - 33_000 + _spread_us(row):
            continue
        pair.look_us = track.t_us
        near_count = _find_near(grid, track, row, range_m, near, apart_squared)
        out_changed[i] = _look_once(
            tracks, pairing, row, declared_rows[i], near[:near_count], range_m, lane_width_m
        )
        changes += out_changed[i]
    return changes


@njit(cache=True)
def leaders_of(tracks: Records, pairing: Records, rows: I64, out_leaders: I64) -> None:
    """Write `leader_of` each of `rows`."""
    for i in range(rows.size):
        out_leaders[i] = leader_of(tracks, pairing, rows[i])


@njit(cache=True)
def gaps_m(tracks: Records, pairing: Records, rows: I64, out_gap_m: NDArray[np.float64]) -> None:
    """Write the distance along the road from each row's front to its leader's rear, m; NaN where it follows nobody."""
    for i in range(rows.size):
        leader_row = leader_of(tracks, pairing, rows[i])
        out_gap_m[i] = np.nan
        if leader_row != NOBODY:
            leader = tracks[leader_row]
            out_gap_m[i] = leader.x_m + pairing[rows[i]].offset_m - tracks[rows[i]].x_m - leader.length_m


@njit(cache=True)
def _begin(pair: np.void, track: np.void, row: int) -> None:
    """Start a row without a leader, its first look up to half a second away."""
    pair.serial = track.serial
    pair.leader_row = pair.challenger_row = NOBODY
    pair.votes = pair.misses = pair.doubts = 0
    pair.declared = False
    pair.look_us = track.t_us - 7 * _spread_us(row)


@njit(cache=True)
def _spread_us(row: int) -> int:
    """Return 0 to 66 ms, another for every row, so that looks do not fall together."""
    return row * 7919 % 65_536


@njit(cache=True)
def _look_once(
    tracks: Records,
    pairing: Records,
    row: int,
    declared_row: int,
    near: I64,
    range_m: float,
    lane_width_m: float,
) -> bool:
    """Bring one row's leader and offset up to date; return whether they are others than before."""
    follower = tracks[row]
    pair = pairing[row]
    before_row = pair.leader_row
    pair.leader_row = leader_of(tracks, pairing, row)
    corridor_m = 0.5 * lane_width_m

    found_row, ahead_m, lateral_m = _find_declared(tracks, row, declared_row, range_m)
    pair.declared = found_row != NOBODY
    if not pair.declared:
        found_row, ahead_m, lateral_m = _find_leader(tracks, row, pair.leader_row, near, range_m, lane_width_m)

    if found_row != NOBODY and found_row == pair.leader_row:
        pair.misses = pair.votes = 0
        pair.challenger_row = NOBODY
        pair.lateral_m = lateral_m
        return _follow_offset(pair, follower, follower.base_x_m + ahead_m - tracks[found_row].base_x_m)

    kept = False
    if pair.leader_row != NOBODY:
        leader = tracks[pair.leader_row]
        leader_ahead_m, leader_lateral_m = _ahead_on_trail(leader, follower, _KEEP_CORRIDOR * corridor_m, range_m)
        kept = leader_ahead_m > 0.0 and _is_fresh(leader, follower)
        pair.misses = 0 if kept else pair.misses + 1

    pair.votes = pair.votes + 1 if found_row == pair.challenger_row else 1
    pair.challenger_row = found_row
    if found_row != NOBODY and (pair.declared or pair.votes >= (VOTES_TO_REPLACE if kept else VOTES_TO_LEAD)):
        pair.leader_row = found_row
        pair.leader_serial = tracks[found_row].serial
        pair.lateral_m = lateral_m
        pair.offset_m = follower.base_x_m + ahead_m - tracks[found_row].base_x_m
        pair.look_x_m = follower.base_x_m
        pair.challenger_row = NOBODY
        pair.votes = pair.misses = pair.doubts = 0
    elif kept:
        pair.lateral_m = leader_lateral_m
        return _follow_offset(pair, follower, follower.base_x_m + leader_ahead_m - leader.base_x_m)
    elif pair.misses >= MISSES_TO_LOSE:
        pair.leader_row = NOBODY
        pair.misses = 0
    return bool(pair.leader_row != before_row)


@njit(cache=True)
def _follow_offset(pair: np.void, follower: np.void, measured_m: float) -> bool:
    """Move the offset towards the one measured, no faster than two paths may part; return whether it had to leap."""
    limit_m = _OFFSET_SLACK_M + _OFFSET_PER_METRE * abs(follower.base_x_m - pair.look_x_m)
    pair.look_x_m = follower.base_x_m
    error_m = measured_m - pair.offset_m
    pair.doubts = pair.doubts + 1 if abs(error_m) > max(4.0 * limit_m, 1.0) else 0
    if pair.doubts >= _DOUBTS_TO_RESET:
        pair.doubts = 0
        pair.offset_m = measured_m
        return True
    pair.offset_m += min(max(_OFFSET_GAIN * error_m, -limit_m), limit_m)
    return False


@njit(cache=True)
def _find_declared(tracks: Records, row: int, declared_row: int, range_m: float) -> tuple[int, float, float]:
    """Return (row, metres ahead, lateral) of the leader the follower names, or NOBODY where it cannot be."""
    if declared_row == NOBODY or declared_row == row:
        return NOBODY, 0.0, 0.0
    follower, leader = tracks[row], tracks[declared_row]
    if leader.t_us == 0 or not _is_fresh(leader, follower):
        return NOBODY, 0.0, 0.0
    east_m, north_m = _between_bases(leader, follower)
    if math.hypot(east_m, north_m) > range_m:
        return NOBODY, 0.0, 0.0
    ahead_m, lateral_m = _ahead_on_trail(leader, follower, _DECLARED_REACH_M, range_m)
    return (declared_row, ahead_m, lateral_m) if ahead_m > 0.0 else (NOBODY, 0.0, 0.0)


@njit(cache=True)
def _find_leader(
    tracks: Records, row: int, leader_row: int, near: I64, range_m: float, lane_width_m: float
) -> tuple[int, float, float]:
    """Return (row, metres ahead, lateral) of the vehicle next ahead in the follower's lane, or NOBODY.

    `near` is sorted by distance as the crow flies, which no way along a road undercuts.
    """
    follower = tracks[row]
    corridor_m = 0.5 * lane_width_m
    first_row, first_m, first_lateral_m = NOBODY, np.inf, 0.0
    second_row, second_m, second_lateral_m = NOBODY, np.inf, 0.0
    for k in range(-1, near.size):
        if k >= 0 and near[k] == leader_row:
            continue
        candidate_row = leader_row if k < 0 else near[k]
        if candidate_row == NOBODY:
            continue
        candidate = tracks[candidate_row]
        if candidate.t_us == 0 or not _is_fresh(candidate, follower):
            continue
        reach_m = corridor_m + _allowance_m(candidate, follower, lane_width_m)
        ahead_m, lateral_m = _ahead_on_trail(candidate, follower, reach_m, range_m)
        if ahead_m <= 0.0:
            continue
        if ahead_m < first_m:
            second_row, second_m, second_lateral_m = first_row, first_m, first_lateral_m
            first_row, first_m, first_lateral_m = candidate_row, ahead_m, lateral_m
        elif ahead_m < second_m:
            second_row, second_m, second_lateral_m = candidate_row, ahead_m, lateral_m
        if second_row != NOBODY and k >= 0:
            break
    if first_row == NOBODY:
        return NOBODY, 0.0, 0.0
    if second_row != NOBODY:
        behind_m, lateral_m = _ahead_on_trail(tracks[second_row], tracks[first_row], 2.0 * lane_width_m, range_m)
        if behind_m > 0.0 and abs(lateral_m) > _GONE_LANES * lane_width_m:
            first_row, first_m, first_lateral_m = second_row, second_m, second_lateral_m
    return _find_cut_in(tracks, row, first_row, first_m, first_lateral_m, near, lane_width_m)


@njit(cache=True)
def _find_cut_in(
    tracks: Records, row: int, witness_row: int, witness_m: float, lateral_m: float, near: I64, lane_width_m: float
) -> tuple[int, float, float]:
    """Return the nearest vehicle ahead that lies on the witness's trail between the two, or the witness itself."""
    follower, witness = tracks[row], tracks[witness_row]
    found_row, found_m = witness_row, witness_m
    for k in range(near.size):
        candidate = tracks[near[k]]
        if near[k] == witness_row or candidate.t_us == 0 or not _is_fresh(candidate, follower):
            continue
        east_m, north_m = _between_bases(candidate, follower)
        if math.hypot(east_m, north_m) >= found_m:
            continue
        reach_m = 0.5 * lane_width_m
        behind_m, _ = _ahead_on_trail(witness, candidate, reach_m, witness_m)
        if behind_m > 0.0 and 0.0 < witness_m - behind_m < found_m:
            found_row, found_m = near[k], witness_m - behind_m
    return found_row, found_m, lateral_m


@njit(cache=True)
def _is_fresh(vehicle: np.void, follower: np.void) -> bool:
    """Whether both were heard at about the same time."""
    return bool(abs(vehicle.t_us - follower.t_us) <= FRESH_US)


@njit(cache=True)
def _allowance_m(vehicle: np.void, follower: np.void, lane_width_m: float) -> float:
    """How much wider than half a lane the corridor is, for the accuracy that the two declare."""
    declared_m = math.hypot(vehicle.accuracy_m, follower.accuracy_m)
    return min(declared_m, _ALLOWANCE_LANES * lane_width_m) if math.isfinite(declared_m) else 0.0


@njit(cache=True)
def _between_bases(from_track: np.void, to_track: np.void) -> tuple[float, float]:
    """Return (east_m, north_m) from the one's base to the other's."""
    return displacement_m(
        from_track.base_lat_deg, from_track.base_lon_deg, to_track.base_lat_deg, to_track.base_lon_deg
    )


@njit(cache=True)
def _ahead_on_trail(ahead: np.void, behind: np.void, reach_m: float, range_m: float) -> tuple[float, float]:
    """Return (metres from `behind` to `ahead` along the trail of the latter, how far left of the trail `behind` is).

    The metres are 0 where the trail does not pass within `reach_m` of the base of `behind`, in its direction, at most
    `range_m` ago. Of several passes the newest counts. The trail is walked backwards in leaps: a place r away from the
    newest crumb cannot lie beside the trail less than r - reach_m before it.
    """
    heading_east, heading_north = behind.base_heading_east, behind.base_heading_north
    if ahead.crumb_count == 0 or (heading_east == 0.0 and heading_north == 0.0):
        return 0.0, 0.0
    east_m, north_m = _between_bases(ahead, behind)
    east_m += ahead.base_east_m
    north_m += ahead.base_north_m
    crumbs = ahead.crumbs
    newest = ahead.newest_crumb
    oldest_back = ahead.crumb_count - 1
    spacing_m = CRUMB_SPACING_M
    if oldest_back > 0:
        oldest = (newest - oldest_back) & (CRUMBS - 1)
        spacing_m = max((crumbs[newest, X] - crumbs[oldest, X]) / oldest_back, CRUMB_SPACING_M)

    best_squared = reach_m * reach_m
    place_m = np.inf
    lateral_m = 0.0
    back = 0
    while back < oldest_back:
        newer = (newest - back) & (CRUMBS - 1)
        if ahead.base_x_m - crumbs[newer, X] > range_m:
            return 0.0, 0.0
        to_east = east_m - crumbs[newer, EAST]
        to_north = north_m - crumbs[newer, NORTH]
        leap_m = 0.9 * (math.hypot(to_east, to_north) - reach_m)
        leap = min(int(leap_m / spacing_m), oldest_back - back)
        while leap > 0 and crumbs[newer, X] - crumbs[(newer - leap) & (CRUMBS - 1), X] > leap_m:
            leap -= 1
        if leap > 0:
            if place_m != np.inf:
                break
            back += leap
            continue
        older = (newer - 1) & (CRUMBS - 1)
        along_east = crumbs[newer, EAST] - crumbs[older, EAST]
        along_north = crumbs[newer, NORTH] - crumbs[older, NORTH]
        length_squared = max(along_east * along_east + along_north * along_north, 1e-6)
        part = 1.0 + (to_east * along_east + to_north * along_north) / length_squared
        back += 1
        if (part > 1.0 and back == 1) or (part < 0.0 and back == oldest_back):
            continue
        part = min(max(part, 0.0), 1.0)
        beside_east = to_east + (1.0 - part) * along_east
        beside_north = to_north + (1.0 - part) * along_north
        apart_squared = beside_east * beside_east + beside_north * beside_north
        if apart_squared < best_squared:
            trail_east, trail_north = _trail_direction(crumbs, newest, back - 1, oldest_back)
            if trail_east * heading_east + trail_north * heading_north >= _TRAIL_COS_MIN:
                best_squared = apart_squared
                place_m = crumbs[older, X] + part * (crumbs[newer, X] - crumbs[older, X])
                lateral_m = math.copysign(
                    math.sqrt(apart_squared), along_east * beside_north - along_north * beside_east
                )
        elif place_m != np.inf:
            break
    if place_m == np.inf:
        place_m, lateral_m = _continue_straight(ahead, east_m, north_m, heading_east, heading_north, reach_m)
    ahead_m = ahead.base_x_m - place_m
    return (ahead_m, lateral_m) if 0.0 < ahead_m <= range_m else (0.0, 0.0)


@njit(cache=True)
def _continue_straight(
    ahead: np.void, east_m: float, north_m: float, heading_east: float, heading_north: float, reach_m: float
) -> tuple[float, float]:
    """Return (odometer, lateral) of a place behind the oldest crumb, on its straight continuation; inf if not there."""
    crumbs = ahead.crumbs
    oldest_back = ahead.crumb_count - 1
    oldest = (ahead.newest_crumb - oldest_back) & (CRUMBS - 1)
    trail_east, trail_north = ahead.base_heading_east, ahead.base_heading_north
    if oldest_back > 2 * _BASELINE:
        trail_east, trail_north = _trail_direction(crumbs, ahead.newest_crumb, oldest_back - _BASELINE, oldest_back)
    if trail_east * heading_east + trail_north * heading_north < _STRAIGHT_COS_MIN:
        return np.inf, 0.0
    to_east = east_m - crumbs[oldest, EAST]
    to_north = north_m - crumbs[oldest, NORTH]
    along_m = to_east * trail_east + to_north * trail_north
    lateral_m = trail_east * to_north - trail_north * to_east
    if along_m > 0.0 or abs(lateral_m) > reach_m:
        return np.inf, 0.0
    return crumbs[oldest, X] + along_m, lateral_m


@njit(cache=True)
def _trail_direction(crumbs: NDArray[np.float64], newest: int, back: int, oldest_back: int) -> tuple[float, float]:
    """Return the unit direction of the trail around the segment that begins `back` crumbs before the newest."""
    newer = (newest - max(back - _BASELINE + 1, 0)) & (CRUMBS - 1)
    older = (newest - min(back + _BASELINE, oldest_back)) & (CRUMBS - 1)
    east = crumbs[newer, EAST] - crumbs[older, EAST]
    north = crumbs[newer, NORTH] - crumbs[older, NORTH]
    length = math.hypot(east, north)
    return (east / length, north / length) if length > 0.0 else (0.0, 0.0)


@njit(cache=True)
def _bucket(band: int, column: int, buckets: int) -> int:
    """Hash a cell; two cells may share a bucket, for the distance is looked at anyway."""
    return (band * 73_856_093 ^ column * 19_349_663) & (buckets - 1)


@njit(cache=True)
def _columns(band: int, cell_deg: float) -> int:
    """Return how many cells, none narrower than `cell_deg` of latitude is long, go round the earth in this band."""
    edge_deg = max(abs(band * cell_deg - 90.0), abs((band + 1) * cell_deg - 90.0))
    narrowest = math.cos(math.radians(min(edge_deg, 90.0))) * _METRES_PER_DEGREE_EQUATOR / _METRES_PER_DEGREE_MIN
    return max(1, int(360.0 * narrowest / cell_deg))


@njit(cache=True)
def _column(lon_deg: float, columns: int) -> int:
    """Return the cell of a longitude in a band of so many."""
    return int(math.floor((lon_deg + 180.0) / 360.0 * columns)) % columns


@njit(cache=True)
def _build(grid: Grid, tracks: Records, range_m: float, now_us: int) -> None:
    """Sort all known vehicles by cell: a counting sort over the buckets."""
    start = grid.bucket_start
    buckets = start.size - 1
    cell_deg = range_m / _METRES_PER_DEGREE_MIN
    start[:] = 0
    count = 0
    for row in range(tracks.size):
        track = tracks[row]
        if track.t_us == 0:
            continue
        band = int((track.base_lat_deg + 90.0) / cell_deg)
        bucket = _bucket(band, _column(track.base_lon_deg, _columns(band, cell_deg)), buckets)
        entry = grid.unsorted[count]
        entry.row = row
        entry.t_us = track.t_us
        entry.lat_deg = track.base_lat_deg
        entry.lon_deg = track.base_lon_deg
        entry.v_mps = track.v_mps
        entry.heading_east = track.base_heading_east
        entry.heading_north = track.base_heading_north
        entry.bucket = bucket
        start[bucket + 1] += 1
        count += 1
    for bucket in range(buckets):
        start[bucket + 1] += start[bucket]
    for i in range(count - 1, -1, -1):
        bucket = grid.unsorted[i].bucket
        start[bucket + 1] -= 1
        grid.entries[start[bucket + 1]] = grid.unsorted[i]
    for bucket in range(buckets):
        start[bucket] = start[bucket + 1]
    start[buckets] = count
    grid.built_us[0] = now_us


@njit(cache=True)
def _find_near(
    grid: Grid, follower: np.void, row: int, range_m: float, near: I64, apart_squared: NDArray[np.float64]
) -> int:
    """Write the rows of the vehicles nearest ahead, nearest first, none of them oncoming; return how many."""
    cell_deg = range_m / _METRES_PER_DEGREE_MIN
    buckets = grid.bucket_start.size - 1
    east_per_degree, north_per_degree = metres_per_degree(follower.base_lat_deg)
    home = int((follower.base_lat_deg + 90.0) / cell_deg)
    count = 0
    for band in range(home - 1, home + 2):
        columns = _columns(band, cell_deg)
        column = _column(follower.base_lon_deg, columns)
        for step in range(-1, 2):
            bucket = _bucket(band, (column + step) % columns, buckets)
            first, end = grid.bucket_start[bucket], grid.bucket_start[bucket + 1]
            for i in range(first, end, (end - first) // _SCAN_PER_CELL + 1):
                entry = grid.entries[i]
                age_s = min(max(1e-6 * (follower.t_us - entry.t_us), -1.0), 1.0)
                east_m = wrap_degrees(entry.lon_deg - follower.base_lon_deg) * east_per_degree
                north_m = (entry.lat_deg - follower.base_lat_deg) * north_per_degree
                east_m += age_s * entry.v_mps * entry.heading_east
                north_m += age_s * entry.v_mps * entry.heading_north
                squared = east_m * east_m + north_m * north_m
                if squared > range_m * range_m or entry.row == row:
                    continue
                if count == _NEAREST and squared >= apart_squared[count - 1]:
                    continue
                if east_m * follower.base_heading_east + north_m * follower.base_heading_north < 0.0:
                    continue
                same_way = (
                    entry.heading_east * follower.base_heading_east + entry.heading_north * follower.base_heading_north
                )
                if same_way < _ONCOMING_COS:
                    continue
                k = min(count, _NEAREST - 1)
                while k > 0 and apart_squared[k - 1] > squared:
                    near[k] = near[k - 1]
                    apart_squared[k] = apart_squared[k - 1]
                    k -= 1
                near[k] = entry.row
                apart_squared[k] = squared
                count = min(count + 1, _NEAREST)
    return count
