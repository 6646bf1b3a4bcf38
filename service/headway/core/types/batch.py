"""The records of one turn as columns: what the codec hands to the core."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Ids = NDArray[np.bytes_]
"""Identifiers, ASCII, of up to 64 characters each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """B validated records; every array is (B,), SI units, NaN where the sender said nothing.

    `heading_deg` is clockwise from north. `t_us` is the sender's event time and `received_us` the local receive time,
    both microseconds of Unix time, UTC. `leader_ids`, `range_m` and `range_rate_mps` are the sender's own forward
    sensor: who is ahead, how far from its reference point, and how fast the distance grows.
    """

    ids: Ids
    leader_ids: Ids
    """Empty where none is declared."""
    msg_cnt: I64
    t_us: I64
    received_us: I64
    lat_deg: F64
    lon_deg: F64
    speed_mps: F64
    heading_deg: F64
    accel_mps2: F64
    accuracy_m: F64
    length_m: F64
    range_m: F64
    range_rate_mps: F64

    def __len__(self) -> int:
        """Return B."""
        return len(self.ids)
