"""The evidence of each row: its last readings, and its state before the first of them.

The bank row is copied once every half ring, before it steps. The older of the two copies and the readings since replay
each verdict in between, bit for bit, through the same kernel.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.records import READING, Records
from headway.core.types.step_result import Evidence


class EvidenceRings(NamedTuple):
    """For each of C rows the last R readings in a ring, the leader at each, and two checkpoints."""

    readings: Records
    """(C, R)"""
    leaders: NDArray[np.int32]
    """(C, R)"""
    checkpoints: Records
    """(C, 2)"""
    counts: I64
    """(C,) readings so far."""


@njit(cache=True, error_model="numpy")
def store_readings(rings: EvidenceRings, bank: Records, rows: I64, readings: Records, leaders: I64) -> None:
    """Store the `readings` and `leaders` (n,) of `rows` (n,); call it before the rows step."""
    size = rings.readings.shape[1]
    half = size // 2
    for i in range(rows.size):
        row = rows[i]
        count = rings.counts[row]
        if count % half == 0:
            rings.checkpoints[row, (count // half) % 2] = bank[row]
        rings.readings[row, count % size] = readings[i]
        rings.leaders[row, count % size] = leaders[i]
        rings.counts[row] = count + 1


class EvidenceStore:
    """Rings of readings and two checkpoints for each row of a bank."""

    def __init__(self, bank: Records, readings: int) -> None:
        if readings < 2 or readings % 2:
            raise ValueError(f"evidence needs an even number of readings, at least 2: got {readings}")
        self.rings = EvidenceRings(
            np.zeros((bank.size, readings), READING),
            np.zeros((bank.size, readings), np.int32),
            np.zeros((bank.size, 2), bank.dtype),
            np.zeros(bank.size, np.int64),
        )

    def of(self, row: int) -> Evidence:
        """Return the evidence that replays the newest verdict of a row."""
        rings = self.rings
        count, size = int(rings.counts[row]), rings.readings.shape[1]
        half = size // 2
        first = max(0, (count - 1) // half - 1) * half
        places = np.arange(first, count) % size
        # As bytes: numpy would copy a record field by field.
        checkpoint = rings.checkpoints.view(np.uint8).reshape(rings.counts.size, 2, -1)[row, (first // half) % 2]
        return Evidence(
            checkpoint=checkpoint.copy().view(rings.checkpoints.dtype)[0],
            readings=rings.readings[row, places],
            leaders=rings.leaders[row, places].astype(np.int64),
        )

    def newest(self, row: int) -> np.void:
        """Return the newest reading of a row."""
        newest: np.void = self.rings.readings[row, (int(self.rings.counts[row]) - 1) % self.rings.readings.shape[1]]
        return newest

    def clear(self, rows: I64) -> None:
        """Clear the evidence of `rows`; call it after any change of their bank rows except by readings."""
        self.rings.counts[rows] = 0
