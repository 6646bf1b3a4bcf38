"""From verdicts to outcomes: one compiled call after the filter."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, PairTestParams, step_pair_tests, substitute_rejected
from headway.core.pipeline.classify import RoundCounts, classify, store
from headway.core.pipeline.ingest import Ingested
from headway.core.pipeline.tables import Limits, Tables
from headway.core.tracking.pairing import find_leaders
from headway.core.tracking.tracks import extend_path_history
from headway.core.types.batch import F64, I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records


class Finalised(NamedTuple):
    """What a wave came to."""

    counts: RoundCounts
    pair_tests: Records
    """(n,) of LINK_VERDICT."""
    marks: NDArray[np.uint8]
    """(n,) of `classify`."""
    nis: F64
    """Of the scored readings."""
    leader_changes: int


_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True)
def finalise(
    tables: Tables,
    ingested: Ingested,
    declared_rows: I64,
    verdicts: Records,
    now_us: int,
    limits: Limits,
    pair_test_params: PairTestParams,
    out_outcomes: NDArray[np.uint8],
) -> Finalised:
    """Take the `verdicts` (n,) of the filter into all tables, and write the outcomes of the readings (B,)."""
    rows, readings = ingested.rows, ingested.readings
    n = rows.size
    located = np.empty(n, np.bool_)
    store(rows, readings, verdicts, tables.newest_verdicts, tables.verdict_t_s, located)
    extend_path_history(tables.tracks, rows, located, verdicts["v_mps"])
    leader_changes = find_leaders(
        tables.tracks,
        tables.pairing,
        tables.grid,
        rows,
        declared_rows[ingested.places],
        now_us,
        limits.pairing_range_m,
        limits.lane_width_m,
        np.empty(n, np.bool_),
    )
    pair_tests = np.zeros(n, PAIR_TEST_VERDICT)
    step_pair_tests(
        tables.pair_tests, rows, ingested.leaders, substitute_rejected(readings, verdicts), pair_test_params, pair_tests
    )
    outcomes, marks = np.empty(n, np.uint8), np.empty(n, np.uint8)
    counts = classify(
        tables.tracks,
        rows,
        verdicts,
        pair_tests,
        ingested.step_us,
        limits.silence_timeout_s,
        limits.warming_readings,
        tables.filter_event_active,
        tables.pair_event_active,
        tables.miss_event_active,
        outcomes,
        marks,
    )
    out_outcomes[ingested.places] = outcomes
    nis = verdicts["nis"][outcomes == _SCORED]
    return Finalised(counts, pair_tests, marks, nis, leader_changes)
