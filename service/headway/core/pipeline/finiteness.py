"""The finiteness of a round: a row whose numbers are none is initialised again, so that none stays blind."""

from math import isfinite
from typing import Any

from numba import njit

from headway.core.pipeline.ingest import Ingested
from headway.core.pipeline.tables import Tables


@njit(cache=True, error_model="numpy")
def reset_not_finite(tables: Tables, ingested: Ingested, model_bytes: int) -> int:
    """Initialise the filter of each row whose verdict is not finite from its reading; return how many.

    `model_bytes` is the length of the filter's part, with which a bank row begins. The verdict becomes one of a filter
    that was just initialised.
    """
    count = 0
    for i in range(ingested.rows.size):
        verdict, reading = ingested.verdicts[i], ingested.readings[i]
        if _is_finite(verdict):
            continue
        count += 1
        tables.bank_bytes[ingested.rows[i], :model_bytes] = 0
        verdict.x_m, verdict.v_mps = reading.x_m, reading.v_mps
        verdict.x_std_m = verdict.v_std_mps = 0.0
        verdict.nis = verdict.statistic = verdict.gate = 0.0
        verdict.p_value, verdict.confidence = 1.0, 0.0
        verdict.nu[:] = 0.0
        verdict.S[:] = 0.0
        verdict.sensor = verdict.kind = 0
        verdict.anomalous = False
        verdict.warming = verdict.restarted = True
    return count


@njit(cache=True, error_model="numpy")
def _is_finite(verdict: Any) -> bool:
    return (
        isfinite(verdict.x_m)
        and isfinite(verdict.v_mps)
        and isfinite(verdict.x_std_m)
        and isfinite(verdict.v_std_mps)
        and isfinite(verdict.statistic)
        and isfinite(verdict.gate)
        and isfinite(verdict.nis)
    )
