"""What is left to do for the readings of a wave once filter and link tests have spoken, in one pass over them."""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.tracking.reception import limit_us
from headway.core.types.batch import F64, I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind, Records, Sensor

_SCORED, _WARMING = np.uint8(Outcome.SCORED), np.uint8(Outcome.WARMING)
_LOCATION = int(Sensor.LOCATION)
_NO_KIND = int(Kind.NONE)

FILTER, LINK, BACK = 1, 2, 4
"""Marks of a reading that the log of the filter's events, that of the link's, or that of misses has to look at."""


class Settled(NamedTuple):
    """Counts over a wave."""

    marks: int
    """All marks of all readings."""
    anomalous: int
    repairs: int
    restarts: int


@njit(cache=True)
def keep(
    rows: I64, readings: Records, verdicts: Records, newest: Records, judged_t_s: F64, out_located: NDArray[np.bool_]
) -> None:
    """Keep each row's newest verdict and its time; `out_located` (B,): the location may be believed."""
    for i in range(rows.size):
        newest[rows[i]] = verdicts[i]
        judged_t_s[rows[i]] = readings[i].t_s
        out_located[i] = verdicts[i].sensor & _LOCATION == 0


@njit(cache=True)
def settle(
    tracks: Records,
    rows: I64,
    verdicts: Any,
    links: Any,
    silent_us: I64,
    silence_timeout_s: float,
    warming_readings: int,
    filter_active: NDArray[np.bool_],
    link_active: NDArray[np.bool_],
    miss_active: NDArray[np.bool_],
    out_outcomes: NDArray[np.uint8],
    out_marks: NDArray[np.uint8],
) -> Settled:
    """Write the outcome of each reading (B,), and mark those that the logs of events have to look at.

    `silent_us` (B,) is the step in event time that brought each vehicle back. The three `active` (C,) say for which
    rows an event of each log is under way.
    """
    marks, anomalous, repairs, restarts = 0, 0, 0, 0
    for i in range(rows.size):
        row, verdict, mark = rows[i], verdicts[i], 0
        out_outcomes[i] = _WARMING if verdict.warming else _SCORED
        if verdict.anomalous or filter_active[row]:
            mark |= FILTER
        if links[i].kind != _NO_KIND or link_active[row]:
            mark |= LINK
        known = tracks[row].count > warming_readings
        if miss_active[row] or (known and silent_us[i] > limit_us(tracks[row].interval_s, silence_timeout_s)):
            mark |= BACK
        out_marks[i] = mark
        marks |= mark
        anomalous += verdict.anomalous
        repairs += verdict.repaired
        restarts += verdict.restarted
    return Settled(marks, anomalous, repairs, restarts)
