"""What a follower reads of its leader: the newest estimate of before this slot. Order within a slot has no effect."""

from typing import Any

import numpy as np
from numba import njit

from headway.core.pipeline.tables import Tables
from headway.core.types.records import Records

ESTIMATE = np.dtype(
    [
        ("slot", "i8"),  # of reception
        ("generation", "i8"),  # of the track
        ("t_s", "f8"),
        ("x_m", "f8"),
        ("v_mps", "f8"),
        ("length_m", "f8"),
    ],
    align=True,
)


def new_estimates(capacity: int) -> Records:
    """Return (C,) empty estimates: no track has generation 0."""
    return np.zeros(capacity, ESTIMATE)


@njit(cache=True, error_model="numpy")
def store_estimate(tables: Tables, row: int, slot: int, t_s: float, verdict: Any) -> None:
    """Store the estimate of a VERDICT for event time `t_s`, received in `slot`."""
    newest, track = tables.estimates[row], tables.tracks[row]
    if newest.slot != slot:
        tables.earlier_estimates[row] = newest
    newest.slot, newest.generation, newest.t_s = slot, track.generation, t_s
    newest.x_m, newest.v_mps, newest.length_m = verdict.x_m, verdict.v_mps, track.length_m


@njit(cache=True, error_model="numpy")
def estimate_before(tables: Tables, row: int, slot: int) -> Any:
    """Return the newest ESTIMATE of before `slot`."""
    newest = tables.estimates[row]
    return tables.earlier_estimates[row] if newest.slot == slot else newest
