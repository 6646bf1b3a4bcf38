"""Cells: squares of the earth's surface, shared out among the engines of one site."""

from dataclasses import dataclass
from itertools import product

import numpy as np

from headway.core.types.batch import F64, I64

_METRES_PER_DEGREE_MIN = 110_574.0  # of latitude, at the equator
_METRES_PER_DEGREE_EQUATOR = 111_319.0  # of longitude
_COS_MIN = 0.01
_BAND_ROWS = 50
"""Rows of cells that are equally wide in longitude, and so one above the other."""


@dataclass(frozen=True, slots=True)
class Lattice:
    """A lattice of squares, shared out along the diagonals, so that along any road the engines take turns.

    Parameters
    ----------
    engines
        How many share the site, at most 63.
    side_m
        Side of a cell, at least twice the halo.
    halo_m
        An engine receives vehicles within this distance of its cells too. At least the pairing range: a pair is whole
        in the engine of its follower.
    """

    engines: int
    side_m: float
    halo_m: float

    def __post_init__(self) -> None:
        if self.side_m < 2.0 * self.halo_m:
            raise ValueError(f"a cell of {self.side_m:g} m is smaller than two halos of {self.halo_m:g} m")

    def owners(self, lat_deg: F64, lon_deg: F64) -> I64:
        """Return (B,) the engine of the cell of each position."""
        cell_deg = self.side_m / _METRES_PER_DEGREE_MIN
        row = np.floor((lat_deg + 90.0) / cell_deg)
        band = np.floor(row / _BAND_ROWS)
        width_deg = self.side_m / _east_m_per_degree((band + 0.5) * _BAND_ROWS * cell_deg - 90.0)
        column = np.floor((lon_deg + 180.0) / width_deg)
        return ((row + column) % self.engines).astype(np.int64)

    def receivers(self, lat_deg: F64, lon_deg: F64) -> I64:
        """Return (B,) the engines that receive each position, as bits: those of all cells within the halo."""
        north_deg = self.halo_m / _METRES_PER_DEGREE_MIN
        east_deg = self.halo_m / _east_m_per_degree(lat_deg)
        bits = np.zeros(lat_deg.size, np.int64)
        for north, east in product((-1.0, 1.0), repeat=2):
            lon = (lon_deg + east * east_deg + 180.0) % 360.0 - 180.0
            bits |= 1 << self.owners(np.clip(lat_deg + north * north_deg, -90.0, 90.0), lon)
        return bits


def _east_m_per_degree(lat_deg: F64) -> F64:
    scaled: F64 = _METRES_PER_DEGREE_EQUATOR * np.maximum(np.cos(np.radians(lat_deg)), _COS_MIN)
    return scaled
