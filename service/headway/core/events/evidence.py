"""The evidence of each row: its last readings, and its state before one of them.

The bank row is copied before it steps, as a checkpoint. The checkpoint and the readings since replay each verdict, bit
for bit, through the same kernel. A row has a second checkpoint only while the newer one has few readings.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.records import COMPACT_READING, READING, Records
from headway.core.types.step_result import Evidence

_NO_CHECKPOINT = np.int32(-1)


class EvidenceRings(NamedTuple):
    """For each of C rows the last R readings in a ring, and the leader at each. The rows share 2 C checkpoints."""

    readings: Records
    """(C, R) COMPACT_READING."""
    leaders: NDArray[np.int32]
    """(C, R)"""
    counts: I64
    """(C,) readings so far."""
    due: I64
    """(C,) the count at which the next checkpoint is taken."""
    places: NDArray[np.int32]
    """(C, 2) of the newest checkpoint and of the one before it; -1: none."""
    taken: I64
    """(C, 2) the counts at which they were taken."""
    checkpoints: Records
    """(2 C,) used from the first place on, so that memory that is never needed is never touched."""
    free: NDArray[np.int32]
    """(2 C,) a stack of places without a checkpoint."""
    free_count: I64
    """(1,) height of that stack."""


@njit(cache=True, error_model="numpy")
def store_readings(rings: EvidenceRings, bank: Records, rows: I64, readings: Records, leaders: I64) -> None:
    """Store the `readings` and `leaders` (n,) of `rows` (n,); call it before the rows step."""
    size = rings.readings.shape[1]
    fewest = size // 4
    between = size - fewest
    for i in range(rows.size):
        row = rows[i]
        count = rings.counts[row]
        if count == 0:
            _release(rings, row, 0)
            _release(rings, row, 1)
            _take(rings, bank, row)
            # By its time, because rows that take their checkpoints together would need memory together.
            rings.due[row] = fewest + int(1000.0 * readings[i].t_s) % between
        elif count == rings.due[row]:
            _take(rings, bank, row)
            rings.due[row] = count + between
        elif count == rings.taken[row, 0] + fewest:
            _release(rings, row, 1)
        _compact(readings[i], rings.readings[row, count % size])
        rings.leaders[row, count % size] = leaders[i]
        rings.counts[row] = count + 1


@njit(cache=True, error_model="numpy")
def _take(rings: EvidenceRings, bank: Records, row: int) -> None:
    """Copy a row to a free checkpoint; the newest one becomes the one before it."""
    _release(rings, row, 1)
    rings.places[row, 1], rings.taken[row, 1] = rings.places[row, 0], rings.taken[row, 0]
    rings.free_count[0] -= 1
    place = rings.free[rings.free_count[0]]
    rings.checkpoints[place] = bank[row]
    rings.places[row, 0], rings.taken[row, 0] = place, rings.counts[row]


@njit(cache=True, error_model="numpy")
def _release(rings: EvidenceRings, row: int, which: int) -> None:
    """Free a checkpoint of a row, if it has that one."""
    if rings.places[row, which] != _NO_CHECKPOINT:
        rings.free[rings.free_count[0]] = rings.places[row, which]
        rings.free_count[0] += 1
        rings.places[row, which] = _NO_CHECKPOINT


@njit(cache=True, error_model="numpy")
def _compact(z: Any, kept: Any) -> None:
    """Copy a READING to a COMPACT_READING."""
    kept.t_s, kept.x_m, kept.odometer_std_m, kept.v_mps = z.t_s, z.x_m, z.odometer_std_m, z.v_mps
    kept.leader_t_s, kept.leader_x_m, kept.leader_v_mps = z.leader_t_s, z.leader_x_m, z.leader_v_mps
    kept.leader_length_m, kept.range_m, kept.range_rate_mps = z.leader_length_m, z.range_m, z.range_rate_mps
    kept.east_m, kept.north_m, kept.heading_deg, kept.accuracy_m = z.east_m, z.north_m, z.heading_deg, z.accuracy_m
    kept.overlapped, kept.appeared, kept.contradictions = z.overlapped, z.appeared, z.contradictions


class EvidenceStore:
    """Readings and checkpoints of the rows of a bank.

    Parameters
    ----------
    bank
        (C,) the rows.
    readings
        Most readings R of one evidence, a multiple of 4. There are at least R / 4 and the newest one, if the row has
        so many.
    """

    def __init__(self, bank: Records, readings: int) -> None:
        if readings < 4 or readings % 4:
            raise ValueError(f"evidence needs a number of readings that is a multiple of 4: got {readings}")
        capacity = bank.size
        self.rings = EvidenceRings(
            readings=np.zeros((capacity, readings), COMPACT_READING),
            leaders=np.zeros((capacity, readings), np.int32),
            counts=np.zeros(capacity, np.int64),
            due=np.zeros(capacity, np.int64),
            places=np.full((capacity, 2), _NO_CHECKPOINT, np.int32),
            taken=np.zeros((capacity, 2), np.int64),
            checkpoints=np.zeros(2 * capacity, bank.dtype),
            free=np.arange(2 * capacity - 1, -1, -1, dtype=np.int32),
            free_count=np.array([2 * capacity]),
        )

    def of(self, row: int) -> Evidence:
        """Return the evidence that replays the newest verdict of a row."""
        rings = self.rings
        count, size = int(rings.counts[row]), rings.readings.shape[1]
        which = int(rings.places[row, 1] != _NO_CHECKPOINT)
        readings = np.arange(rings.taken[row, which], count) % size
        # As bytes: numpy would copy a record field by field.
        checkpoint = rings.checkpoints.view(np.uint8).reshape(rings.checkpoints.size, -1)[rings.places[row, which]]
        return Evidence(
            checkpoint=checkpoint.copy().view(rings.checkpoints.dtype)[0],
            readings=rings.readings[row, readings][list(READING.names or ())].astype(READING),
            leaders=rings.leaders[row, readings].astype(np.int64),
        )

    def newest(self, row: int) -> np.void:
        """Return the newest reading of a row."""
        newest: np.void = self.rings.readings[row, (int(self.rings.counts[row]) - 1) % self.rings.readings.shape[1]]
        return newest

    def clear(self, rows: I64) -> None:
        """Clear the evidence of `rows`; call it after any change of their bank rows except by readings."""
        self.rings.counts[rows] = 0
