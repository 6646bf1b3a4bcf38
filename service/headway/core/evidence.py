"""What a verdict can be computed again from: each row's last readings, and its state before the first of them.

Every half ring the bank row is copied before it steps; the older of the two copies and the readings since replay every
verdict in between, bit for bit, through the same kernel.
"""

from typing import Any

import numpy as np
from numba import njit

from headway.core.batch import I64
from headway.core.records import READING, Records
from headway.core.turn import Evidence


@njit(cache=True)
def _remember(
    bank: Any, rows: Any, readings: Any, leaders: Any, ring: Any, leader_ring: Any, checkpoints: Any, counts: Any
) -> None:
    size = ring.shape[1]
    half = size // 2
    for i in range(rows.size):
        row = rows[i]
        count = counts[row]
        if count % half == 0:
            checkpoints[row, (count // half) % 2] = bank[row]
        ring[row, count % size] = readings[i]
        leader_ring[row, count % size] = leaders[i]
        counts[row] = count + 1


class EvidenceStore:
    """Rings of readings and two checkpoints for each row of a bank."""

    def __init__(self, bank: Records, readings: int) -> None:
        if readings < 2 or readings % 2:
            raise ValueError(f"evidence needs an even number of readings, at least 2: got {readings}")
        self._ring: Records = np.zeros((bank.size, readings), READING)
        self._leaders: I64 = np.zeros((bank.size, readings), np.int64)
        self._checkpoints: Records = np.zeros((bank.size, 2), bank.dtype)
        self._counts: I64 = np.zeros(bank.size, np.int64)

    def remember(self, bank: Records, rows: I64, readings: Records, leaders: I64) -> None:
        """Take in the readings that `rows` are about to be judged by, and whom they follow; call before any steps."""
        _remember(bank, rows, readings, leaders, self._ring, self._leaders, self._checkpoints, self._counts)

    def of(self, row: int) -> Evidence:
        """Return what replays the newest verdict of a row."""
        count, size = int(self._counts[row]), self._ring.shape[1]
        half = size // 2
        first = max(0, (count - 1) // half - 1) * half
        places = np.arange(first, count) % size
        # As bytes: numpy would copy a record field by field.
        checkpoint = self._checkpoints.view(np.uint8).reshape(self._counts.size, 2, -1)[row, (first // half) % 2]
        return Evidence(
            checkpoint=checkpoint.copy().view(self._checkpoints.dtype)[0],
            readings=self._ring[row, places],
            leaders=self._leaders[row, places],
        )

    def forget(self, rows: I64) -> None:
        """Drop everything about `rows`: their banks were changed by something else than readings."""
        self._counts[rows] = 0
