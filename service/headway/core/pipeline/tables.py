"""What a round of records works on: the tables of all vehicles, the columns of a batch, the limits."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.events.evidence import EvidenceRings
from headway.core.tracking.spatial_index import Grid
from headway.core.types.batch import F64, I64, Batch
from headway.core.types.records import Records


class Tables(NamedTuple):
    """All that is kept of the vehicles, (C,) each."""

    tracks: Records
    pairing: Records
    grid: Grid
    bank: Records
    bank_bytes: NDArray[np.uint8]
    """(C, bytes) the bank once more: a row of bytes is wiped faster than a record."""
    pair_tests: Records
    newest_verdicts: Records
    """Each vehicle's newest verdict."""
    verdict_t_s: F64
    rings: EvidenceRings
    filter_event_active: NDArray[np.bool_]
    pair_event_active: NDArray[np.bool_]
    miss_event_active: NDArray[np.bool_]


class Columns(NamedTuple):
    """(B,) the columns of a `Batch` that are numbers."""

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


class Limits(NamedTuple):
    """The share of the configuration that a wave needs."""

    max_gap_s: float
    pairing_range_m: float
    lane_width_m: float
    silence_timeout_s: float
    warming_readings: int


def columns(batch: Batch) -> Columns:
    """Return the columns of a batch that a wave looks at, contiguous and of one type each (`kernels`)."""
    return Columns(
        t_us=_whole(batch.t_us),
        received_us=_whole(batch.received_us),
        msg_cnt=_whole(batch.msg_cnt),
        lat_deg=_real(batch.lat_deg),
        lon_deg=_real(batch.lon_deg),
        speed_mps=_real(batch.speed_mps),
        heading_deg=_real(batch.heading_deg),
        accuracy_m=_real(batch.accuracy_m),
        length_m=_real(batch.length_m),
        range_m=_real(batch.range_m),
        range_rate_mps=_real(batch.range_rate_mps),
    )


def _whole(column: I64) -> I64:
    return np.ascontiguousarray(column, np.int64)


def _real(column: F64) -> F64:
    return np.ascontiguousarray(column, np.float64)
