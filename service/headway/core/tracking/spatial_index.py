"""The vehicles near a place: an index by cell of latitude and longitude, with a bound on the time of each search."""

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.tracking.geodesy import metres_per_degree, wrap_degrees
from headway.core.tracking.tracks import is_free
from headway.core.types.batch import F64, I64
from headway.core.types.records import Records

NEAREST = 12
"""Most vehicles that one search returns."""

REBUILD_US = 250_000
"""The index is built once in each interval of so long; until then, vehicles are extrapolated by their speed."""

_SCAN_PER_CELL = 256  # of a cell with more entries, every n-th is examined
_ONCOMING_COS = -0.5
_BESIDE_M = 4.0  # a base lags its vehicle by up to one spacing, so one beside may be ahead
_METRES_PER_DEGREE_MIN = 110_574.0  # of latitude, at the equator
_METRES_PER_DEGREE_EQUATOR = 111_319.0  # of longitude

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
    """The vehicles sorted by the cell they were in at `built_us`; not part of a snapshot."""

    entries: Records
    unsorted: Records
    bucket_start: I64
    built_us: I64


def new_grid(capacity: int) -> Grid:
    """Return an empty index for `capacity` vehicles."""
    buckets = 1 << max(10, (2 * capacity - 1).bit_length())
    return Grid(
        np.zeros(capacity, _ENTRY),
        np.zeros(capacity, _ENTRY),
        np.zeros(buckets + 1, np.int64),
        np.full(1, -REBUILD_US, np.int64),
    )


@njit(cache=True, error_model="numpy")
def _bucket(band: int, column: int, buckets: int) -> int:
    """Hash a cell; two cells may share a bucket, because each search checks the distance."""
    return (band * 73_856_093 ^ column * 19_349_663) & (buckets - 1)


@njit(cache=True, error_model="numpy")
def _columns(band: int, cell_deg: float) -> int:
    """Return the number of cells around the earth in this band, none narrower than `cell_deg` of latitude."""
    edge_deg = max(abs(band * cell_deg - 90.0), abs((band + 1) * cell_deg - 90.0))
    narrowest = math.cos(math.radians(min(edge_deg, 90.0))) * _METRES_PER_DEGREE_EQUATOR / _METRES_PER_DEGREE_MIN
    return max(1, int(360.0 * narrowest / cell_deg))


@njit(cache=True, error_model="numpy")
def _column(lon_deg: float, columns: int) -> int:
    """Return the cell of a longitude in a band of `columns` cells."""
    return math.floor((lon_deg + 180.0) / 360.0 * columns) % columns


@njit(cache=True, error_model="numpy")
def build(grid: Grid, tracks: Records, range_m: float, now_us: int) -> None:
    """Sort all known vehicles by cell, with a counting sort over the buckets."""
    start = grid.bucket_start
    buckets = start.size - 1
    cell_deg = range_m / _METRES_PER_DEGREE_MIN
    start[:] = 0
    count = 0
    for row in range(tracks.size):
        track = tracks[row]
        if is_free(track):
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


@njit(cache=True, error_model="numpy")
def find_near(grid: Grid, follower: Any, row: int, range_m: float, nearby: I64, apart_squared: F64) -> int:
    """Write the rows of the vehicles nearest ahead or beside, nearest first, none oncoming; return how many."""
    cell_deg = range_m / _METRES_PER_DEGREE_MIN
    buckets = grid.bucket_start.size - 1
    lat_deg, lon_deg = follower.base_lat_deg, follower.base_lon_deg
    heading_east, heading_north = follower.base_heading_east, follower.base_heading_north
    east_per_degree, north_per_degree = metres_per_degree(lat_deg)
    home = int((lat_deg + 90.0) / cell_deg)
    farthest = range_m * range_m
    count = 0
    for band in range(home - 1, home + 2):
        columns = _columns(band, cell_deg)
        column = _column(lon_deg, columns)
        for step in range(-1, 2):
            bucket = _bucket(band, (column + step) % columns, buckets)
            first, end = grid.bucket_start[bucket], grid.bucket_start[bucket + 1]
            stride = 1 if end - first <= _SCAN_PER_CELL else (end - first) // _SCAN_PER_CELL + 1
            for i in range(first, end, stride):
                entry = grid.entries[i]
                age_s = min(max(1e-6 * (follower.t_us - entry.t_us), -1.0), 1.0)
                moved_m = age_s * entry.v_mps
                east_m = wrap_degrees(entry.lon_deg - lon_deg) * east_per_degree + moved_m * entry.heading_east
                north_m = (entry.lat_deg - lat_deg) * north_per_degree + moved_m * entry.heading_north
                squared = east_m * east_m + north_m * north_m
                if (
                    squared > farthest
                    or east_m * heading_east + north_m * heading_north < -_BESIDE_M
                    or entry.heading_east * heading_east + entry.heading_north * heading_north < _ONCOMING_COS
                    or entry.row == row
                ):
                    continue
                k = min(count, NEAREST - 1)
                while k > 0 and apart_squared[k - 1] > squared:
                    nearby[k] = nearby[k - 1]
                    apart_squared[k] = apart_squared[k - 1]
                    k -= 1
                nearby[k] = entry.row
                apart_squared[k] = squared
                count = min(count + 1, NEAREST)
                if count == NEAREST:
                    farthest = apart_squared[count - 1]
    return count
