"""The order of the records of a batch: by event time, in rounds in which each vehicle occurs at most once."""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.outcome import Outcome

_SCORED = np.uint8(Outcome.SCORED)
_TOO_OLD = np.uint8(Outcome.TOO_OLD)
_FROM_THE_FUTURE = np.uint8(Outcome.FROM_THE_FUTURE)


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


@njit(cache=True, error_model="numpy")
def rounds(rows: I64, t_us: I64, outcomes: NDArray[np.uint8], records_by_row: I64) -> tuple[I64, I64, int]:
    """Return (order, nth, count) of the n records that are not rejected so far.

    `order` (n,) are their places by event time, then row. `nth` (n,) is the number of earlier records of the same
    vehicle, so records of equal `nth` form a round of distinct vehicles. `count` is the number of rounds.
    `records_by_row` (C,) is workspace, all zeros before and after.
    """
    taken = np.flatnonzero(outcomes == _SCORED)
    by_row = taken[np.argsort(rows[taken], kind="mergesort")]
    order = by_row[np.argsort(t_us[by_row], kind="mergesort")]
    nth = np.empty(order.size, np.int64)
    count = 0
    for i in range(order.size):
        row = rows[order[i]]
        nth[i] = records_by_row[row]
        records_by_row[row] += 1
        count = max(count, records_by_row[row])
    for i in range(order.size):
        records_by_row[rows[order[i]]] = 0
    return order, nth, count
