"""A wave of records through all tables: one compiled call before the filter, one after it.

A call from Python costs microseconds, more than the work on a single record; a turn of twenty records is mostly calls.
"""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.batch import F64, I64, Batch
from headway.core.evidence import Memory, remember
from headway.core.gather import gather
from headway.core.link import LINK_VERDICT, LinkParams, standing, step_links
from headway.core.neighbours import Grid
from headway.core.outcome import Outcome
from headway.core.pairing import look
from headway.core.records import READING, Records
from headway.core.settle import Settled, keep, settle
from headway.core.tracks import advance, leave_crumb

_SCORED = np.uint8(Outcome.SCORED)


class Tables(NamedTuple):
    """All that is kept of the vehicles, (C,) each."""

    tracks: Records
    pairing: Records
    grid: Grid
    bank: Records
    bank_bytes: NDArray[np.uint8]
    """(C, bytes) the bank once more: a row of bytes is wiped faster than a record."""
    links: Records
    newest: Records
    """Each vehicle's newest verdict."""
    judged_t_s: F64
    memory: Memory
    filter_active: NDArray[np.bool_]
    link_active: NDArray[np.bool_]
    miss_active: NDArray[np.bool_]


class Columns(NamedTuple):
    """(B,) the columns of a `Batch` that are numbers."""

    t_us: I64
    received_us: I64
    msg_cnt: I64
    lat_deg: F64
    lon_deg: F64
    speed_mps: F64
    heading_deg: F64
    accuracy_m: F64
    length_m: F64
    range_m: F64
    range_rate_mps: F64


class Limits(NamedTuple):
    """The share of the configuration that a wave needs."""

    max_gap_s: float
    pairing_range_m: float
    lane_width_m: float
    miss_after_s: float
    warming_readings: int


class Entered(NamedTuple):
    """The n records of a wave that are to be judged."""

    places: I64
    """(n,) in the batch."""
    rows: I64
    leaders: I64
    """(n,) row of each one's leader, NOBODY for none."""
    readings: Records
    heard_us: I64
    """(n,) when each vehicle was heard before."""
    silent_us: I64
    """(n,) step in event time that brought each back."""
    missed: int
    """Messages lost before these, as the senders' counters say."""


class Concluded(NamedTuple):
    """What a wave came to."""

    settled: Settled
    links: Records
    """(n,) of LINK_VERDICT."""
    marks: NDArray[np.uint8]
    """(n,) of `settle`."""
    nis: F64
    """Of the scored readings."""
    leader_changes: int


def columns(batch: Batch) -> Columns:
    """Return the columns of a batch that a wave looks at, contiguous and of one type each (`kernels`)."""
    return Columns(
        t_us=_whole(batch.t_us),
        received_us=_whole(batch.received_us),
        msg_cnt=_whole(batch.msg_cnt),
        lat_deg=_real(batch.lat_deg),
        lon_deg=_real(batch.lon_deg),
        speed_mps=_real(batch.speed_mps),
        heading_deg=_real(batch.heading_deg),
        accuracy_m=_real(batch.accuracy_m),
        length_m=_real(batch.length_m),
        range_m=_real(batch.range_m),
        range_rate_mps=_real(batch.range_rate_mps),
    )


def _whole(column: I64) -> I64:
    return np.ascontiguousarray(column, np.int64)


def _real(column: F64) -> F64:
    return np.ascontiguousarray(column, np.float64)


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
    heard_us, silent_us = np.empty(wave.size, np.int64), np.empty(wave.size, np.int64)
    for i in range(wave.size):
        heard_us[i], silent_us[i] = tracks[rows[i]].received_us, -tracks[rows[i]].t_us
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
            tables.memory.counts[rows[i]] = 0
        if outcome[i] != _SCORED:
            out_outcomes[wave[i]] = outcome[i]
            continue
        places[n], rows[n], heard_us[n] = wave[i], rows[i], heard_us[i]
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
    remember(tables.memory, tables.bank, rows, readings, leaders)
    return Entered(places, rows, leaders, readings, heard_us[:n], silent_us[:n], missed.sum())


@njit(cache=True)
def conclude(
    tables: Tables,
    entered: Entered,
    declared_rows: I64,
    verdicts: Records,
    now_us: int,
    limits: Limits,
    link_params: LinkParams,
    out_outcomes: NDArray[np.uint8],
) -> Concluded:
    """Take the `verdicts` (n,) of the filter into all tables, and write the outcomes of the readings (B,)."""
    rows, readings = entered.rows, entered.readings
    n = rows.size
    located = np.empty(n, np.bool_)
    keep(rows, readings, verdicts, tables.newest, tables.judged_t_s, located)
    leave_crumb(tables.tracks, rows, located, verdicts["v_mps"])
    leader_changes = look(
        tables.tracks,
        tables.pairing,
        tables.grid,
        rows,
        declared_rows[entered.places],
        now_us,
        limits.pairing_range_m,
        limits.lane_width_m,
        np.empty(n, np.bool_),
    )
    links = np.zeros(n, LINK_VERDICT)
    step_links(tables.links, rows, entered.leaders, standing(readings, verdicts), link_params, links)
    outcomes, marks = np.empty(n, np.uint8), np.empty(n, np.uint8)
    settled = settle(
        tables.tracks,
        rows,
        verdicts,
        links,
        entered.silent_us,
        limits.miss_after_s,
        limits.warming_readings,
        tables.filter_active,
        tables.link_active,
        tables.miss_active,
        outcomes,
        marks,
    )
    out_outcomes[entered.places] = outcomes
    nis = verdicts["nis"][outcomes == _SCORED]
    return Concluded(settled, links, marks, nis, leader_changes)
