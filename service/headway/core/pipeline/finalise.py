"""From verdicts to outcomes: one compiled call after the motion model."""

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, step_pair_tests, substitute_rejected
from headway.core.pipeline.classify import Classified, classify, store
from headway.core.pipeline.finiteness import reset_runaways
from headway.core.pipeline.ingest import Ingested
from headway.core.pipeline.tables import RoundParams, Tables
from headway.core.plausibility.checks import combine
from headway.core.tracking.pairing import searches_due
from headway.core.tracking.tracks import extend_path_history
from headway.core.types.batch import F64, I64
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records


class Finalised(NamedTuple):
    """The result of a round."""

    classified: Classified
    pair_verdicts: Records
    """(n,) of PAIR_TEST_VERDICT."""
    nis: F64
    """Of the scored readings."""
    search_due: I64
    """Places among the n readings of those whose search for the leader is due."""
    resets: int
    """Filters initialised again because their numbers were not finite."""


_SCORED = np.uint8(Outcome.SCORED)


@njit(cache=True, error_model="numpy")
def finalise(
    tables: Tables,
    ingested: Ingested,
    received_us: I64,
    params: RoundParams,
    out_outcomes: NDArray[np.uint8],
) -> Finalised:
    """Update all tables with the verdicts (n,) of checks and model, and write the outcomes (B,).

    `received_us` (B,) are the times of reception, all of one slot.
    """
    rows, verdicts = ingested.rows, ingested.verdicts
    resets = reset_runaways(tables, ingested, params.model_bytes)
    combine(tables.plausibility, rows, params.limits, verdicts)
    location_valid = store(tables, ingested, received_us, verdicts)
    extend_path_history(tables.tracks, rows, location_valid, verdicts["v_mps"], verdicts["S"][:, 0, 0])
    search_due = searches_due(tables.tracks, tables.pairing, rows)
    pair_verdicts = np.zeros(rows.size, PAIR_TEST_VERDICT)
    substituted = substitute_rejected(ingested.readings, verdicts)
    step_pair_tests(tables.pair_tests, rows, ingested.leaders, substituted, params.pair_tests, pair_verdicts)
    classified = classify(tables, ingested, verdicts, pair_verdicts, params)
    out_outcomes[ingested.places] = classified.outcomes
    nis = verdicts["nis"][(classified.outcomes == _SCORED) & tables.owned[rows]]
    return Finalised(classified, pair_verdicts, nis, search_due, resets)
