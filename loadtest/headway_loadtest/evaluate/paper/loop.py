"""The closed loop: the service's own kernel judges a drive, and what it rejects is replaced before the next reading.

Two choices that are the experiment's, not the service's, live here and nowhere in the core:

`Recovery.GROUND_TRUTH` lets the filter learn from the truth where its reading was rejected, and then puts the estimate
on it (H s = truth). It is an oracle: the published Table 1 rests on it, and no service has one.
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
    """What stands in for an estimate whose reading was rejected."""

    GROUND_TRUTH = "ground-truth"
    PREDICTION = "prediction"


class History(StrEnum):
    """What the filter takes for its own past between t - tau and t."""

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
    judged = verdicts(len(readings))
    oracle, constant = recovery is Recovery.GROUND_TRUTH, history is History.CONSTANT
    judge(bank[0], readings, p, follower.x_m, follower.v_mps, oracle, constant, judged)
    return judged


@njit(cache=True, error_model="numpy")
def judge(
    row: Any, readings: Any, p: FilterParams, true_x_m: F64, true_v_mps: F64, oracle: bool, constant: bool, judged: Any
) -> None:
    """`step` along a drive, with the experiment's history before it and its oracle after."""
    workspace = np.zeros(1, WORKSPACE)
    for k in range(readings.size):
        if constant and p.delay_s > 0.0 and row.count > 0:
            flatten_history(row, p.delay_s)
        step(row, readings[k], p, judged[k], workspace[0])
        if oracle and judged[k].anomalous:
            stand_in_truth(row, true_x_m[k], true_v_mps[k], p, workspace[0])
            judged[k].x_m = true_x_m[k]
            judged[k].v_mps = true_v_mps[k]


@njit(cache=True, error_model="numpy")
def flatten_history(row: Any, delay_s: float) -> None:
    """Write the present estimate over the whole past that the next prediction can see."""
    row.own_count = 0
    push_own(row, row.t_s - delay_s - 1.0)
    push_own(row, row.t_s)


@njit(cache=True, error_model="numpy")
def stand_in_truth(row: Any, x_m: float, v_mps: float, p: FilterParams, workspace: Any) -> None:
    """Update with the truth as the reading, then set s so that H s is the truth, in the newest memory as well.

    Who knows the truth need not begin anew: the rejections are forgotten.
    """
    update(row, innovate(row, x_m, v_mps, p), p, workspace)
    row.s[0] = x_m - row.s[2] if row.s.size == 3 else x_m
    row.s[1] = v_mps
    row.rejections = 0
    newest = (row.own_count - 1) % row.own_t.size
    row.own_s[newest, :] = row.s
    row.own_P[newest, :, :] = row.P
