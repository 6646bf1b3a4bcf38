"""The finiteness of a round: a row whose numbers are not finite is initialised again, so that none stays blind.

So is one whose estimate no vehicle can have. Where both sensors are faulty, nothing corrects a state, and one that runs
away would overflow later.
"""

from math import isfinite
from typing import Any

from numba import njit

from headway.core.pipeline.ingest import Ingested
from headway.core.pipeline.tables import Tables

SPEED_MAX_MPS = 1e3
"""No vehicle is as fast: a message holds 163.8 m/s at most (SAE J2735, Speed)."""
APART_MAX_M = 1e8
"""Two places on Earth are nearer to each other, however a vehicle goes from one to the other."""


@njit(cache=True, error_model="numpy")
def reset_runaways(tables: Tables, ingested: Ingested, model_bytes: int) -> int:
    """Initialise the filter of each row whose verdict is not finite, or not possible, from its reading.

    `model_bytes` is the length of the filter's part, with which a bank row begins. The verdict becomes one of a filter
    that was just initialised. Return how many were not finite.
    """
    count = 0
    for i in range(ingested.rows.size):
        verdict, reading = ingested.verdicts[i], ingested.readings[i]
        is_finite = _is_finite(verdict)
        if is_finite and abs(verdict.v_mps) < SPEED_MAX_MPS and abs(verdict.x_m - reading.x_m) < APART_MAX_M:
            continue
        count += not is_finite
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
