"""The closed loop: the service's kernel runs along a drive, and a rejected reading is replaced before the next one.

Two choices belong to the experiment and not to the service, so they are here and not in the core:

`Recovery.GROUND_TRUTH` updates the filter by the truth where its reading was rejected, and then sets the estimate to it
(H s = truth). The published Table 1 rests on this oracle, which no service has.
`History.CONSTANT` takes the estimate's past to be its present (s(t - tau) = s(t), P likewise) while the leader's input
is truly delayed, as the published solver does. `History.BUFFERS` is the equation as written, and what the service runs.
"""

from enum import StrEnum
from typing import Any

import numpy as np
from numba import njit

from headway.core.estimation.delay_buffers import push_own
from headway.core.estimation.delayed_ekf import WORKSPACE, FilterParams, innovate, step, update
from headway.core.estimation.registry import paper_dtype, paper_params
from headway.core.runtime.rows import verdicts
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Records
from headway_loadtest.evaluate.paper.follower import Follower
from headway_loadtest.sources.drive import F64

ORDERS = {"ekf": 2, "aekf": 3}
DELAY_MAX_S = 5.0
"""Every delay shares one row layout, so that the kernel compiles once per model."""


class Recovery(StrEnum):
    """What replaces an estimate whose reading was rejected."""

    GROUND_TRUTH = "ground-truth"
    PREDICTION = "prediction"


class History(StrEnum):
    """The filter's own past between t - tau and t."""

    CONSTANT = "constant"
    BUFFERS = "buffers"


def params(model: str, delay_s: float, delay_jitter_s: float = 0.0) -> FilterParams:
    """Return the published numbers, without the service's warm-up; the gate is each run's own."""
    config = DetectorConfig(model=model, delay_s=delay_s, delay_jitter_s=delay_jitter_s, warming_readings=0)
    return paper_params(config)._replace(gate=np.inf)


def run(
    model: str, p: FilterParams, follower: Follower, readings: Records, recovery: Recovery, history: History
) -> Records:
    """Return the VERDICT of each reading (n,), the estimate in it being the one after recovery."""
    bank = np.zeros(1, paper_dtype(ORDERS[model], DELAY_MAX_S))
    results = verdicts(len(readings))
    oracle, constant = recovery is Recovery.GROUND_TRUTH, history is History.CONSTANT
    run_closed_loop(bank[0], readings, p, follower.x_m, follower.v_mps, oracle, constant, results)
    return results


@njit(cache=True, error_model="numpy")
def run_closed_loop(
    row: Any, readings: Any, p: FilterParams, true_x_m: F64, true_v_mps: F64, oracle: bool, constant: bool, results: Any
) -> None:
    """`step` along a drive, with the experiment's history before it and its oracle after."""
    workspace = np.zeros(1, WORKSPACE)
    for k in range(readings.size):
        if constant and p.delay_s > 0.0 and row.count > 0:
            flatten_history(row, p.delay_s)
        step(row, readings[k], p, results[k], workspace[0])
        if oracle and results[k].anomalous:
            substitute_truth(row, true_x_m[k], true_v_mps[k], p, workspace[0])
            results[k].x_m = true_x_m[k]
            results[k].v_mps = true_v_mps[k]


@njit(cache=True, error_model="numpy")
def flatten_history(row: Any, delay_s: float) -> None:
    """Write the present estimate over the whole past that the next prediction can see."""
    row.own_count = 0
    push_own(row, row.t_s - delay_s - 1.0)
    push_own(row, row.t_s)


@njit(cache=True, error_model="numpy")
def substitute_truth(row: Any, x_m: float, v_mps: float, p: FilterParams, workspace: Any) -> None:
    """Update with the truth as the reading, then set s so that H s is the truth, in the newest memory as well.

    The count of rejections returns to 0, so that the oracle is never initialised again.
    """
    update(row, innovate(row, x_m, v_mps, p), p, workspace)
    row.s[0] = x_m - row.s[2] if row.s.size == 3 else x_m
    row.s[1] = v_mps
    row.rejections = 0
    newest = (row.own_count - 1) % row.own_t.size
    row.own_s[newest, :] = row.s
    row.own_P[newest, :, :] = row.P
