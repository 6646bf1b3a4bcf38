"""From records to readings: one compiled call before the filter."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.events.evidence import store_readings
from headway.core.pipeline.build_readings import build_readings
from headway.core.pipeline.tables import Columns, Tables
from headway.core.tracking.tracks import advance
from headway.core.types.batch import I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import READING, Records


class Ingested(NamedTuple):
    """The n records of a wave that are to be judged."""

    places: I64
    """(n,) in the batch."""
    rows: I64
    leaders: I64
    """(n,) row of each one's leader, NO_LEADER for none."""
    readings: Records
    last_received_us: I64
    """(n,) when each vehicle was heard before."""
    step_us: I64
    """(n,) step in event time that brought each back."""
    sequence_gaps: int
    """Messages lost before these, as the senders' counters say."""


_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True)
def ingest(
    tables: Tables,
    batch: Columns,
    all_rows: I64,
    declared_rows: I64,
    round_places: I64,
    max_gap_s: float,
    out_outcomes: NDArray[np.uint8],
) -> Ingested:
    """Add the records of distinct vehicles to their tracks, and build a reading for each accepted record.

    `round_places` (w,) are their places in the columns of `batch`, in `all_rows`, `declared_rows` and `out_outcomes`,
    all (B,). The outcome of each rejected record, such as a duplicate, is written.
    """
    tracks = tables.tracks
    rows = all_rows[round_places]
    last_received_us, step_us = np.empty(round_places.size, np.int64), np.empty(round_places.size, np.int64)
    for i in range(round_places.size):
        last_received_us[i], step_us[i] = tracks[rows[i]].received_us, -tracks[rows[i]].t_us
    outcome = np.empty(round_places.size, np.uint8)
    sequence_gaps, initialised = np.empty(round_places.size, np.int64), np.empty(round_places.size, np.bool_)
    advance(
        tracks,
        rows,
        batch.t_us[round_places],
        batch.received_us[round_places],
        batch.msg_cnt[round_places],
        batch.lat_deg[round_places],
        batch.lon_deg[round_places],
        batch.speed_mps[round_places],
        batch.heading_deg[round_places],
        batch.accuracy_m[round_places],
        batch.length_m[round_places],
        max_gap_s,
        outcome,
        np.empty(round_places.size),
        sequence_gaps,
        initialised,
    )
    places, n = np.empty(round_places.size, np.int64), 0
    for i in range(round_places.size):
        if initialised[i]:
            tables.bank_bytes[rows[i]] = 0
            tables.rings.counts[rows[i]] = 0
        if outcome[i] != _SCORED:
            out_outcomes[round_places[i]] = outcome[i]
            continue
        places[n], rows[n], last_received_us[n] = round_places[i], rows[i], last_received_us[i]
        step_us[n] = step_us[i] + batch.t_us[round_places[i]]
        n += 1
    places, rows = places[:n], rows[:n]
    leaders, readings = np.empty(n, np.int64), np.empty(n, READING)
    build_readings(
        tracks,
        tables.pairing,
        tables.verdict_t_s,
        tables.newest_verdicts,
        rows,
        declared_rows,
        places,
        batch.range_m,
        batch.range_rate_mps,
        readings,
        leaders,
    )
    store_readings(tables.rings, tables.bank, rows, readings, leaders)
    return Ingested(places, rows, leaders, readings, last_received_us[:n], step_us[:n], sequence_gaps.sum())
