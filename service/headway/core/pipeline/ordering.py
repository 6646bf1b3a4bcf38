"""The order of the records of a batch: that of their arrival, so that the batches have no effect on the result.

Time of reception is divided into slots. What concerns all vehicles at once, the search for leaders and housekeeping, is
done between two slots. Within a slot a record meets the state that all records before it left behind.
"""

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.types.batch import I64
from headway.core.types.outcome import Outcome

SLOT_US = 10_000
CLOCK_SET_BACK_US = 1_000_000
"""A receive time that lies less far back arrived late from another thread or source; it counts as the newest."""

_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True, error_model="numpy")
def receive_times(received_us: I64, newest_us: int, out_received_us: I64, out_starts: I64) -> int:
    """Write times of reception (B,) that do not go back, and the place of the first record of each slot.

    `newest_us` is the newest time of reception so far. A clock that is set back by more than CLOCK_SET_BACK_US is
    followed: time goes on from there. Return the number of slots.
    """
    count = 0
    for i in range(received_us.size):
        slot = newest_us // SLOT_US
        if received_us[i] >= newest_us or received_us[i] < newest_us - CLOCK_SET_BACK_US:
            newest_us = received_us[i]
        out_received_us[i] = newest_us
        if i == 0 or newest_us // SLOT_US != slot:
            out_starts[count] = i
            count += 1
    return count


@njit(cache=True, error_model="numpy")
def rounds(
    rows: I64, leader_rows: I64, suspect_rows: I64, outcomes: NDArray[np.uint8], workspace: I64
) -> tuple[I64, I64, int]:
    """Return (places, nth, count) of the n records that are not rejected so far.

    `places` (n,) are in the order of arrival. Beside its vehicle, a record concerns the leader and the suspect of the
    pair's open event: `leader_rows` and `suspect_rows` (C,), negative for none. Its round `nth` (n,) comes after those
    of earlier records of its vehicle, and not before those of any earlier record that concerns one of the three.
    `count` is the number of rounds. `workspace` (C, 2) is all zeros before and after.
    """
    places, nth = np.empty(rows.size, np.int64), np.empty(rows.size, np.int64)
    after, not_before = workspace[:, 0], workspace[:, 1]
    n, count = 0, 0
    for i in range(rows.size):
        if outcomes[i] != _SCORED:
            continue
        row, first = rows[i], after[rows[i]]
        concerned = (row, leader_rows[row], suspect_rows[row])
        for other in concerned:
            if other >= 0:
                first = max(first, not_before[other])
        for other in concerned:
            if other >= 0:
                not_before[other] = first
        after[row] = first + 1
        places[n], nth[n] = i, first
        count = max(count, first + 1)
        n += 1
    for i in range(n):
        row = rows[places[i]]
        after[row] = 0
        for other in (row, leader_rows[row], suspect_rows[row]):
            if other >= 0:
                not_before[other] = 0
    return places[:n], nth[:n], count
