"""Where the site receives: cells of the road that vehicles were received in, learnt from all of them.

A vehicle that falls silent at the edge of coverage has left it. One that falls silent where others are received further
along is silent itself. Cells are about 50 m wide; a table of fixed size keeps those that were entered last.
"""

import math
from typing import Any

import numpy as np
from numba import njit

from headway.core.tracking.geodesy import displaced_deg
from headway.core.types.records import Records

CELLS = 1 << 14
"""Cells kept: 400 km of road in both directions. A power of two."""

_CELL_DEG = 4.5e-4  # 50 m of latitude
_BEYOND_S = 2.0  # how far ahead of a silent vehicle others must have been received
_BEYOND_MIN_M = 75.0  # another cell, in each direction: the own one is that of the edge as well
_ENTRIES_MIN = 3

CELL = np.dtype([("key", "i8"), ("entries", "i8")], align=True)
"""A cell, and how many vehicles entered it; all zeros is an empty slot."""


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
    track.cell_key = key
    cell = coverage[_slot(key)]
    if cell.key != key:
        cell.key, cell.entries = key, 0
    cell.entries += 1


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
