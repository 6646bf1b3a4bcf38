"""After the verdicts: store them, and classify each reading by its outcome and by the logs that need it."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.pipeline.estimates import store_estimate
from headway.core.pipeline.ingest import Ingested
from headway.core.pipeline.ordering import SLOT_US
from headway.core.pipeline.tables import RoundParams, Tables
from headway.core.runtime.prefetch import prefetch_row
from headway.core.types.batch import I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind, Records, Sensor

_SCORED, _WARMING = np.uint8(Outcome.SCORED), np.uint8(Outcome.WARMING)
_LOCATION = int(Sensor.LOCATION)
_NO_KIND = int(Kind.NONE)

FILTER_EVENT, PAIR_EVENT, REAPPEARED = 1, 2, 4
"""Marks of a reading: for the log of the filter's events, of the pair tests' events, of misses."""


class Classified(NamedTuple):
    """The classes of the n readings of a round, and counts over them."""

    outcomes: NDArray[np.uint8]
    """(n,) SCORED or WARMING."""
    marks: NDArray[np.uint8]
    """(n,)"""
    all_marks: int
    """The marks of all readings, or-ed."""
    anomalous: int
    repairs: int
    restarts: int


@njit(cache=True, error_model="numpy")
def store(tables: Tables, ingested: Ingested, received_us: I64, verdicts: Records) -> NDArray[np.bool_]:
    """Store each row's newest verdict and estimate, received at `received_us` (B,); return (n,) valid locations."""
    rows, location_valid = ingested.rows, np.empty(ingested.rows.size, np.bool_)
    newest_verdicts, newest, earlier = tables.newest_verdicts, tables.estimates, tables.earlier_estimates
    for i in range(rows.size):
        if i + 1 < rows.size:
            prefetch_row(newest_verdicts, rows[i + 1], 0, newest_verdicts.itemsize)
            prefetch_row(newest, rows[i + 1], 0, newest.itemsize)
            prefetch_row(earlier, rows[i + 1], 0, earlier.itemsize)
        row, slot = rows[i], received_us[ingested.places[i]] // SLOT_US
        newest_verdicts[row] = verdicts[i]
        store_estimate(newest[row], earlier[row], tables.tracks[row], slot, ingested.readings[i].t_s, verdicts[i])
        location_valid[i] = verdicts[i].sensor & _LOCATION == 0
    return location_valid


@njit(cache=True, error_model="numpy")
def classify(
    tables: Tables, ingested: Ingested, verdicts: Records, pair_verdicts: Records, params: RoundParams
) -> Classified:
    """Return the outcome of each reading, and marks for the logs that need it: of a fault, or of an open event."""
    rows = ingested.rows
    outcomes, marks = np.empty(rows.size, np.uint8), np.empty(rows.size, np.uint8)
    all_marks, anomalous, repairs, restarts = 0, 0, 0, 0
    for i in range(rows.size):
        row, track, verdict, mark = rows[i], tables.tracks[rows[i]], verdicts[i], 0
        outcomes[i] = _WARMING if verdict.warming else _SCORED
        if verdict.anomalous or tables.filter_event_active[row]:
            mark |= FILTER_EVENT
        if pair_verdicts[i].kind != _NO_KIND or tables.pair_event_active[row]:
            mark |= PAIR_EVENT
        late = ingested.step_us[i] > ingested.silence_limit_us[i]
        if tables.miss_event_active[row] or (late and track.count > params.warming_readings):
            mark |= REAPPEARED
        marks[i] = mark
        all_marks |= mark
        if tables.owned[row]:
            anomalous += verdict.anomalous
            repairs += verdict.repaired
            restarts += verdict.restarted
    return Classified(outcomes, marks, all_marks, anomalous, repairs, restarts)
