"""What a follower reads of its leader: the newest estimate of before this slot. Order within a slot has no effect."""

from typing import Any

import numpy as np
from numba import njit

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
def store_estimate(newest: Any, earlier: Any, track: Any, slot: int, t_s: float, verdict: Any) -> None:
    """Store the estimate of a VERDICT for event time `t_s`, received in `slot`, in the two of its row (ESTIMATE)."""
    if newest.slot != slot:
        earlier.slot, earlier.generation, earlier.t_s = newest.slot, newest.generation, newest.t_s
        earlier.x_m, earlier.v_mps, earlier.length_m = newest.x_m, newest.v_mps, newest.length_m
    newest.slot, newest.generation, newest.t_s = slot, track.generation, t_s
    newest.x_m, newest.v_mps, newest.length_m = verdict.x_m, verdict.v_mps, track.length_m


@njit(cache=True, error_model="numpy")
def estimate_before(newest: Any, earlier: Any, slot: int) -> Any:
    """Return the newest ESTIMATE of before `slot`."""
    return earlier if newest.slot == slot else newest
