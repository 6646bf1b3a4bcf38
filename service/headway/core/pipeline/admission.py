"""Which records of a batch are admitted: by their age, and by the rows of their vehicles."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.id_index import IdIndex, find
from headway.core.types.batch import I64
from headway.core.types.identifiers import Words
from headway.core.types.outcome import Outcome

_SCORED = np.uint8(Outcome.SCORED)
_TOO_OLD = np.uint8(Outcome.TOO_OLD)
_FROM_THE_FUTURE = np.uint8(Outcome.FROM_THE_FUTURE)


@njit(cache=True, error_model="numpy")
def admit(
    id_index: IdIndex,
    ids: Words,
    leader_ids: Words,
    t_us: I64,
    received_us: I64,
    max_age_us: float,
    max_ahead_us: float,
    out_outcomes: NDArray[np.uint8],
    out_rows: I64,
    out_leader_rows: I64,
) -> bool:
    """Write the outcome by age (B,), and the rows (B,) of vehicles and declared leaders; -1: none.

    Return whether each vehicle has a row.
    """
    reject_by_age(t_us, received_us, max_age_us, max_ahead_us, out_outcomes)
    find(id_index, ids, out_rows)
    find(id_index, leader_ids, out_leader_rows)
    return bool(np.all(out_rows >= 0))


@njit(cache=True, error_model="numpy")
def reject_by_age(
    t_us: I64, received_us: I64, max_age_us: float, max_ahead_us: float, out_outcomes: NDArray[np.uint8]
) -> None:
    """Write the outcome of each record (B,) by its age: SCORED, TOO_OLD or FROM_THE_FUTURE."""
    for i in range(t_us.size):
        age_us = received_us[i] - t_us[i]
        out_outcomes[i] = _SCORED
        if age_us > max_age_us:
            out_outcomes[i] = _TOO_OLD
        elif age_us < -max_ahead_us:
            out_outcomes[i] = _FROM_THE_FUTURE
