"""The arguments of the kernels of a round: the tables of all vehicles, and the parameters."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import PairTestParams
from headway.core.events.evidence import EvidenceTables
from headway.core.plausibility.limits import Limits
from headway.core.tracking.spatial_index import Grid
from headway.core.types.records import Records


class Tables(NamedTuple):
    """The state of all vehicles; each table is (C,), one row for each vehicle."""

    tracks: Records
    pairing: Records
    grid: Grid
    coverage: Records
    """Of the site, not of vehicles: (CELLS,)."""
    bank: Records
    bank_bytes: NDArray[np.uint8]
    """(C, bytes) a view of the bank: clearing a row of bytes is faster than clearing a record."""
    pair_tests: Records
    plausibility: Records
    newest_verdicts: Records
    estimates: Records
    """What a follower reads of each vehicle,"""
    earlier_estimates: Records
    """and the newest of an earlier slot than that."""
    evidence: EvidenceTables
    filter_event_active: NDArray[np.bool_]
    pair_event_active: NDArray[np.bool_]
    miss_event_active: NDArray[np.bool_]
    owned: NDArray[np.bool_]
    """False: another engine publishes and counts this vehicle; here it is judged for its neighbours."""


class RoundParams(NamedTuple):
    """The parameters of a round beside those of the motion model; names as in `DetectorConfig`."""

    max_gap_s: float
    pairing_range_m: float
    lane_width_m: float
    silence_timeout_s: float
    warming_readings: int
    pair_tests: PairTestParams
    limits: Limits
    model_bytes: int
    """Length of the motion model's part, with which a bank row begins."""
