"""From verdicts to outcomes: one compiled call after the filter."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import LINK_VERDICT, LinkParams, standing, step_links
from headway.core.pipeline.classify import Settled, keep, settle
from headway.core.pipeline.ingest import Entered
from headway.core.pipeline.tables import Limits, Tables
from headway.core.tracking.pairing import look
from headway.core.tracking.tracks import leave_crumb
from headway.core.types.batch import F64, I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records


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


_SCORED = np.uint8(Outcome.SCORED)


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
        limits.silence_timeout_s,
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
