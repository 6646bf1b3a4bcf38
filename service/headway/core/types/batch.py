"""The records of one step as columns: what the codec passes to the core."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Ids = NDArray[np.bytes_]
"""Identifiers, ASCII, of up to 64 characters each."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Batch:
    """B validated records; every array is (B,), in SI units, NaN for a value that is not available.

    `heading_deg` is clockwise from north. `t_us` is the sender's event time and `received_us` the local receive time,
    both in microseconds of Unix time, UTC. `leader_ids`, `range_m` and `range_rate_mps` come from the sender's forward
    sensor: the vehicle ahead, the distance to it, and the rate of change of that distance.
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


class Columns(NamedTuple):
    """(B,) the columns of a `Batch` that kernels read, contiguous and of one type each (`bound_kernel`)."""

    t_us: I64
    received_us: I64
    msg_cnt: I64
    lat_deg: F64
    lon_deg: F64
    speed_mps: F64
    heading_deg: F64
    accuracy_m: F64
    length_m: F64
    range_m: F64
    range_rate_mps: F64


def columns(batch: Batch, received_us: I64) -> Columns:
    """Return the columns of a batch for kernels, with other times of reception (B,)."""
    return Columns(
        t_us=_int64(batch.t_us),
        received_us=received_us,
        msg_cnt=_int64(batch.msg_cnt),
        lat_deg=_float64(batch.lat_deg),
        lon_deg=_float64(batch.lon_deg),
        speed_mps=_float64(batch.speed_mps),
        heading_deg=_float64(batch.heading_deg),
        accuracy_m=_float64(batch.accuracy_m),
        length_m=_float64(batch.length_m),
        range_m=_float64(batch.range_m),
        range_rate_mps=_float64(batch.range_rate_mps),
    )


def _int64(column: I64) -> I64:
    return np.ascontiguousarray(column, np.int64)


def _float64(column: F64) -> F64:
    return np.ascontiguousarray(column, np.float64)
