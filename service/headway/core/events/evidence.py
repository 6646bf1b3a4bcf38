"""What a verdict can be computed again from: each row's last readings, and its state before the first of them.

Every half ring the bank row is copied before it steps; the older of the two copies and the readings since replay every
verdict in between, bit for bit, through the same kernel.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.records import READING, Records
from headway.core.types.step_result import Evidence


class EvidenceRings(NamedTuple):
    """Of each of C rows the last R readings in a ring, with the leader at each, and two checkpoints."""

    readings: Records
    """(C, R)"""
    leaders: NDArray[np.int32]
    """(C, R)"""
    checkpoints: Records
    """(C, 2)"""
    counts: I64
    """(C,) readings so far."""


@njit(cache=True)
def store_readings(rings: EvidenceRings, bank: Records, rows: I64, readings: Records, leaders: I64) -> None:
    """Take in the readings that `rows` (B,) are about to be judged by, and whom they follow; call before any steps."""
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
        """Return what replays the newest verdict of a row."""
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

    def clear(self, rows: I64) -> None:
        """Drop everything about `rows`: their banks were changed by something else than readings."""
        self.rings.counts[rows] = 0
