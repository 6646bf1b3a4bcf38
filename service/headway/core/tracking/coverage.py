"""Where the site receives: cells of the road that vehicles were received in, learnt from all of them.

A vehicle that falls silent at the edge of coverage has left it. One that falls silent where others are received further
along is silent itself. Cells are about 50 m wide; a table of fixed size keeps those that were entered last.

**Sudden appearance.** Vehicles are first received at the edge of coverage, or where they park. One that drives when it
is first received, in the middle of road on which others hardly ever begin, did not come there. It may have changed its
pseudonym, or have been silent: then another vehicle fell silent within its reach. So it is judged a little later.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from headway.core.tracking.geodesy import displaced_deg, displacement_m
from headway.core.types.records import Records

CELLS = 1 << 14
"""Cells kept: 400 km of road in both directions. A power of two."""

_CELL_DEG = 4.5e-4  # 50 m of latitude
_BEYOND_S = 2.0  # how far ahead of a silent vehicle others must have been received
_BEYOND_MIN_M = 75.0  # another cell, in each direction: the own one is that of the edge as well
_ENTRIES_MIN = 3

_BIRTHS_REACH = 2  # cells to each side in which a vehicle may begin as well: 100 m of lost messages
_BIRTHS_SHARE = 0.01
_OBSERVED_ENTRIES = 30
_DRIVING_MPS = 8.0
_JUDGED_US, _SILENT_US, _RECEIVING_US = 2_500_000, 20_000_000, 20_000_000
_OVERTAKEN_US = 300_000  # the last message under an old pseudonym may come after the first one under the new
_REACH_SHARE, _REACH_M = 1.3, 30.0
APPEARED_US = 5_000_000
"""For so long an appearance is told."""

CELL = np.dtype([("key", "i8"), ("entries", "i8"), ("births", "i8")], align=True)
"""A cell, how many vehicles entered it, and how many of them were first received in it; all zeros is an empty slot."""


def new_coverage() -> Records:
    """Return CELLS empty cells."""
    return np.zeros(CELLS, CELL)


@njit(cache=True, error_model="numpy")
def cell_key(lat_deg: float, lon_deg: float) -> int:
    """Return the number of the cell of a position, above 0."""
    row, column = math.floor(lat_deg / _CELL_DEG) + 500_000, math.floor(lon_deg / _CELL_DEG) + 500_000
    return row * 1_000_000 + column


@njit(cache=True, error_model="numpy")
def enter_cell(coverage: Records, track: Any) -> None:
    """Count the vehicle in the cell of its newest position, once for each time it enters."""
    key = cell_key(track.lat_deg, track.lon_deg)
    if key == track.cell_key:
        return
    is_new = track.cell_key == 0
    if is_new and track.v_mps > _DRIVING_MPS and _is_inside(coverage, key):
        track.appeared_us = track.t_us
    track.cell_key = key
    cell = coverage[_slot(key)]
    if cell.key != key:
        cell.key, cell.entries, cell.births = key, 0, 0
    cell.entries += 1
    cell.births += is_new


@njit(cache=True, error_model="numpy")
def judge_appearance(tracks: Records, row: int, now_us: int, receiving_since_us: int) -> None:
    """Drop the appearance of a vehicle, once it is judged, where something else explains it.

    `receiving_since_us` is when the site last received nobody, a time as `now_us`.
    """
    track = tracks[row]
    if track.appeared_us == 0 or track.appearance_stands or track.t_us - track.appeared_us < _JUDGED_US:
        return
    track.appearance_stands = now_us - receiving_since_us > _RECEIVING_US
    for other_row in range(tracks.size):
        other = tracks[other_row]
        silent_us = track.appeared_us - other.t_us
        if other.t_us == 0 or not -_OVERTAKEN_US <= silent_us < _SILENT_US:
            continue
        east_m, north_m = displacement_m(other.lat_deg, other.lon_deg, track.lat_deg, track.lon_deg)
        reach_m = _REACH_SHARE * max(other.v_mps, track.v_mps) * 1e-6 * (track.t_us - other.t_us) + _REACH_M
        if math.hypot(east_m, north_m) < reach_m:
            track.appearance_stands = False
    if not track.appearance_stands:
        track.appeared_us = 0


@njit(cache=True, error_model="numpy")
def is_appearing(track: Any) -> bool:
    """Whether a sudden appearance is told now."""
    return bool(track.appearance_stands and track.t_us - track.appeared_us < _JUDGED_US + APPEARED_US)


@njit(cache=True, error_model="numpy")
def _is_inside(coverage: Records, key: int) -> bool:
    """Whether a cell is on road that is well observed, and on which vehicles hardly ever begin."""
    cell = coverage[_slot(key)]
    if cell.key != key or cell.entries < _OBSERVED_ENTRIES:
        return False
    entries, births = 0, 0
    for rows in range(-_BIRTHS_REACH, _BIRTHS_REACH + 1):
        for columns in range(-_BIRTHS_REACH, _BIRTHS_REACH + 1):
            other_key = key + 1_000_000 * rows + columns
            other = coverage[_slot(other_key)]
            if other.key == other_key:
                entries += other.entries
                births += other.births
    return bool(births < _BIRTHS_SHARE * entries)


@njit(cache=True, error_model="numpy")
def is_covered_beyond(coverage: Records, track: Any, silent_s: float) -> bool:
    """Whether others were received further along the course than the vehicle can be after `silent_s` of silence."""
    ahead_m = max(track.v_mps * (silent_s + _BEYOND_S), _BEYOND_MIN_M)
    lat_deg, lon_deg = displaced_deg(
        track.lat_deg, track.lon_deg, ahead_m * track.heading_east, ahead_m * track.heading_north
    )
    key = cell_key(lat_deg, lon_deg)
    cell = coverage[_slot(key)]
    return bool(cell.key == key and cell.entries >= _ENTRIES_MIN)


@njit(cache=True, error_model="numpy")
def _slot(key: int) -> int:
    """Return where the cell is kept (Fibonacci hashing)."""
    return int((key * 0x9E3779B97F4A7C1 >> 20) & (CELLS - 1))
