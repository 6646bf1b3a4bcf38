"""From records to readings: one compiled call before the motion model."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.events.evidence import store_readings
from headway.core.pipeline.build_readings import build_readings
from headway.core.pipeline.tables import RoundParams, Tables
from headway.core.plausibility.checks import check_readings
from headway.core.tracking.reception import limit_us, pause_limit_us
from headway.core.tracking.tracks import advance
from headway.core.types.batch import I64, Columns
from headway.core.types.outcome import Outcome
from headway.core.types.records import VERDICT, Records


class Ingested(NamedTuple):
    """The n accepted records of a round, each (n,)."""

    places: I64
    """Places in the batch."""
    rows: I64
    leaders: I64
    """Row of each one's leader, NO_LEADER for none."""
    readings: Records
    verdicts: Records
    """Written by the plausibility checks so far; the motion model writes the rest."""
    last_received_us: I64
    """Receive time of the vehicle's previous message; 0: none."""
    step_us: I64
    """Event time since the previous message."""
    silence_limit_us: I64
    """Silence after which the sender was overdue."""
    sequence_gaps: int
    """Messages lost before these, by `msg_cnt`."""


_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True, error_model="numpy")
def ingest(
    tables: Tables,
    batch: Columns,
    all_rows: I64,
    declared_rows: I64,
    round_places: I64,
    absent_until_us: int,
    params: RoundParams,
    out_outcomes: NDArray[np.uint8],
) -> Ingested:
    """Add the records of distinct vehicles to their tracks, and build a reading for each accepted record.

    `round_places` (w,) are their places in the columns of `batch`, in `all_rows`, `declared_rows` and `out_outcomes`,
    all (B,). The outcome of each rejected record, such as a duplicate, is written.

    A vehicle that starts again after a gap is not known any more. If the service could not receive before
    `absent_until_us`, the gap says nothing of the vehicle, so the motion model keeps its row and what it has learnt.
    """
    tracks, rows = tables.tracks, all_rows[round_places]
    last_received_us, step_us = np.empty(rows.size, np.int64), np.empty(rows.size, np.int64)
    pause_limits_us, silence_limits_us = np.empty(rows.size, np.int64), np.empty(rows.size, np.int64)
    for i in range(rows.size):
        pause_limits_us[i] = pause_limit_us(tracks[rows[i]], params.silence_timeout_s)
        silence_limits_us[i] = limit_us(tracks[rows[i]], params.silence_timeout_s)
        last_received_us[i], step_us[i] = tracks[rows[i]].received_us, -tracks[rows[i]].t_us
    advanced = advance(tracks, rows, batch, round_places, params.max_gap_s)
    places, n, sequence_gaps = np.empty(rows.size, np.int64), 0, 0
    for i in range(rows.size):
        place = round_places[i]
        if tables.owned[rows[i]]:
            sequence_gaps += advanced.sequence_gap[i]
        if advanced.initialised[i]:
            kept_bytes = params.model_bytes if last_received_us[i] < absent_until_us else 0
            tables.bank_bytes[rows[i], kept_bytes:] = 0
            tables.evidence.segments[rows[i]].count = 0
        if advanced.outcome[i] != _SCORED:
            out_outcomes[place] = advanced.outcome[i]
            continue
        places[n], rows[n], last_received_us[n] = place, rows[i], last_received_us[i]
        step_us[n] = step_us[i] + batch.t_us[place]
        is_loss = advanced.sequence_gap[i] and not advanced.initialised[i]
        silence_limits_us[n] = silence_limits_us[i] if is_loss else pause_limits_us[i]
        n += 1
    places, rows = places[:n], rows[:n]
    readings, leaders = build_readings(tables, batch, rows, places, declared_rows)
    store_readings(tables.evidence, rows, readings, leaders)
    verdicts = np.zeros(n, VERDICT)
    check_readings(tables.plausibility, rows, readings, params.limits, verdicts)
    return Ingested(
        places,
        rows,
        leaders,
        readings,
        verdicts,
        last_received_us[:n],
        step_us[:n],
        silence_limits_us[:n],
        sequence_gaps,
    )
