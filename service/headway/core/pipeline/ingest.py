"""From records to readings: one compiled call before the filter."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.events.evidence import store_readings
from headway.core.pipeline.build_readings import gather
from headway.core.pipeline.tables import Columns, Tables
from headway.core.tracking.tracks import advance
from headway.core.types.batch import I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import READING, Records


class Entered(NamedTuple):
    """The n records of a wave that are to be judged."""

    places: I64
    """(n,) in the batch."""
    rows: I64
    leaders: I64
    """(n,) row of each one's leader, NOBODY for none."""
    readings: Records
    last_received_us: I64
    """(n,) when each vehicle was heard before."""
    silent_us: I64
    """(n,) step in event time that brought each back."""
    missed: int
    """Messages lost before these, as the senders' counters say."""


_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True)
def enter(
    tables: Tables,
    batch: Columns,
    all_rows: I64,
    declared_rows: I64,
    wave: I64,
    max_gap_s: float,
    out_outcomes: NDArray[np.uint8],
) -> Entered:
    """Take the records of distinct vehicles into their tracks, and make readings of those that are to be judged.

    `wave` (w,) are their places in the columns of `batch`, in `all_rows`, `declared_rows` and `out_outcomes`, all (B,);
    the outcomes of the others, duplicates and such, are written.
    """
    tracks = tables.tracks
    rows = all_rows[wave]
    last_received_us, silent_us = np.empty(wave.size, np.int64), np.empty(wave.size, np.int64)
    for i in range(wave.size):
        last_received_us[i], silent_us[i] = tracks[rows[i]].received_us, -tracks[rows[i]].t_us
    outcome = np.empty(wave.size, np.uint8)
    missed, began = np.empty(wave.size, np.int64), np.empty(wave.size, np.bool_)
    advance(
        tracks,
        rows,
        batch.t_us[wave],
        batch.received_us[wave],
        batch.msg_cnt[wave],
        batch.lat_deg[wave],
        batch.lon_deg[wave],
        batch.speed_mps[wave],
        batch.heading_deg[wave],
        batch.accuracy_m[wave],
        batch.length_m[wave],
        max_gap_s,
        outcome,
        np.empty(wave.size),
        missed,
        began,
    )
    places, n = np.empty(wave.size, np.int64), 0
    for i in range(wave.size):
        if began[i]:
            tables.bank_bytes[rows[i]] = 0
            tables.rings.counts[rows[i]] = 0
        if outcome[i] != _SCORED:
            out_outcomes[wave[i]] = outcome[i]
            continue
        places[n], rows[n], last_received_us[n] = wave[i], rows[i], last_received_us[i]
        silent_us[n] = silent_us[i] + batch.t_us[wave[i]]
        n += 1
    places, rows = places[:n], rows[:n]
    leaders, readings = np.empty(n, np.int64), np.empty(n, READING)
    gather(
        tracks,
        tables.pairing,
        tables.judged_t_s,
        tables.newest,
        rows,
        declared_rows,
        places,
        batch.range_m,
        batch.range_rate_mps,
        readings,
        leaders,
    )
    store_readings(tables.rings, tables.bank, rows, readings, leaders)
    return Entered(places, rows, leaders, readings, last_received_us[:n], silent_us[:n], missed.sum())
