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

FILTER_EVENT, PAIR_EVENT, REAPPEARED = 1, 2, 4
"""Marks of a reading that the log of the filter's events, that of the link's, or that of misses has to look at."""


class RoundCounts(NamedTuple):
    """Counts over a wave."""

    marks: int
    """All marks of all readings."""
    anomalous: int
    repairs: int
    restarts: int


@njit(cache=True)
def store(
    rows: I64,
    readings: Records,
    verdicts: Records,
    newest_verdicts: Records,
    verdict_t_s: F64,
    out_located: NDArray[np.bool_],
) -> None:
    """Keep each row's newest verdict and its time; `out_located` (B,): the location may be believed."""
    for i in range(rows.size):
        newest_verdicts[rows[i]] = verdicts[i]
        verdict_t_s[rows[i]] = readings[i].t_s
        out_located[i] = verdicts[i].sensor & _LOCATION == 0


@njit(cache=True)
def classify(
    tracks: Records,
    rows: I64,
    verdicts: Any,
    pair_tests: Any,
    step_us: I64,
    silence_timeout_s: float,
    warming_readings: int,
    filter_event_active: NDArray[np.bool_],
    pair_event_active: NDArray[np.bool_],
    miss_event_active: NDArray[np.bool_],
    out_outcomes: NDArray[np.uint8],
    out_marks: NDArray[np.uint8],
) -> RoundCounts:
    """Write the outcome of each reading (B,), and mark those that the logs of events have to look at.

    `step_us` (B,) is the step in event time that brought each vehicle back. The three `active` (C,) say for which
    rows an event of each log is under way.
    """
    marks, anomalous, repairs, restarts = 0, 0, 0, 0
    for i in range(rows.size):
        row, verdict, mark = rows[i], verdicts[i], 0
        out_outcomes[i] = _WARMING if verdict.warming else _SCORED
        if verdict.anomalous or filter_event_active[row]:
            mark |= FILTER_EVENT
        if pair_tests[i].kind != _NO_KIND or pair_event_active[row]:
            mark |= PAIR_EVENT
        known = tracks[row].count > warming_readings
        if miss_event_active[row] or (known and step_us[i] > limit_us(tracks[row].interval_s, silence_timeout_s)):
            mark |= REAPPEARED
        out_marks[i] = mark
        marks |= mark
        anomalous += verdict.anomalous
        repairs += verdict.repaired
        restarts += verdict.restarted
    return RoundCounts(marks, anomalous, repairs, restarts)
