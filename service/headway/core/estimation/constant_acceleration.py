"""The baseline model `ca`: one car by itself, x' = v, v' = a, a' = white jerk; no leader, no delay, one gate.

Both readings are taken or, when nis exceeds the chi-square gate, both are rejected and the prediction stands.
"""

from math import exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.special import chdtri

from headway.core.estimation.delayed_ekf import isolate
from headway.core.estimation.kinematics import (
    NO_ROLES,
    PX,
    VV,
    VX,
    XV,
    XX,
    Z_POSITION,
    Z_SPEED,
    filters,
    initialise,
    predict,
    update_scalar,
)
from headway.core.statistics.fault_shape import EPISODE, close, kind_of, take
from headway.core.statistics.innovation import nis_2d
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Sensor

NOMINAL_HZ = 10.0
CA = np.dtype(
    [
        ("count", "i8"),  # readings taken; 0: a row not begun
        ("t_s", "f8"),
        ("estimate", filters(1)),  # as in `motion`, nobody lying
        ("rejections", "i8"),  # in a row, up to now
        ("episode", EPISODE),  # of the readings rejected in a row
    ],
    align=True,
)
SPEED_LIES = int(Sensor.SPEED)


class CaParams(NamedTuple):
    """Numbers of the model: set by hand, the same for every car."""

    gate: float
    sensor_gate: float
    max_gap_s: float
    warming_readings: int
    rejections_max: int = 30
    """After so many rejections in a row the filter begins anew from the reading."""
    r_x: float = 4e-4
    r_v: float = 4e-4
    jerk: float = 0.3
    a_var: float = 1.0


def ca_params(config: DetectorConfig) -> CaParams:
    """Return the chi-square gates that the alarm budget asks for, at 10 Hz and if all noise were Gaussian."""
    share = min(0.5, config.alarm_budget_per_hour / (3600.0 * NOMINAL_HZ))
    return CaParams(
        gate=float(chdtri(2, share)),
        sensor_gate=float(chdtri(1, share)),
        max_gap_s=config.max_gap_s,
        warming_readings=config.warming_readings,
    )


@njit(cache=True, error_model="numpy")
def reject(row: Any, nu_x: float, nu_v: float, s_xx: float, s_vv: float, p: CaParams, verdict: Any) -> None:
    """Name sensor and kind of a rejected reading."""
    verdict.sensor = isolate(nu_x, nu_v, s_xx, s_vv, p.sensor_gate)
    if verdict.sensor == SPEED_LIES:
        take(row.episode, nu_v)
        verdict.kind, verdict.confidence = kind_of(row.episode, p.r_v)
    else:
        take(row.episode, nu_x)
        verdict.kind, verdict.confidence = kind_of(row.episode, p.r_x)


@njit(cache=True, error_model="numpy")
def step_row(row: Any, z: Any, p: CaParams, verdict: Any) -> None:
    """Judge one reading (READING) against one row (CA), in place, and write the VERDICT."""
    m = row.estimate.m
    dt_s = z.t_s - row.t_s
    row.t_s = z.t_s
    nu_x, nu_v, nis = 0.0, 0.0, 0.0
    anew = row.count == 0 or dt_s > p.max_gap_s
    if anew:
        verdict.restarted = row.count > 0
        row.count = 0
        s_xx, s_xv, s_vv = p.r_x, 0.0, p.r_v
    else:
        predict(row.estimate, dt_s, p.jerk, 0.0)
        nu_x, nu_v = z.x_m - m[PX, 0], z.v_mps - m[VX, 0]
        s_xx, s_xv, s_vv = m[XX, 0] + p.r_x, m[XV, 0], m[VV, 0] + p.r_v
        nis = nis_2d(nu_x, nu_v, s_xx, s_xv, s_vv, p.r_v)
        verdict.anomalous = row.count >= p.warming_readings and nis > p.gate
        if verdict.anomalous:
            reject(row, nu_x, nu_v, s_xx, s_vv, p, verdict)
            row.rejections += 1
            anew = row.rejections >= p.rejections_max
            verdict.restarted = anew
        else:
            update_scalar(row.estimate, Z_POSITION, z.x_m, p.r_x, 0.0, NO_ROLES)
            update_scalar(row.estimate, Z_SPEED, z.v_mps, p.r_v, 0.0, NO_ROLES)
            row.rejections = 0
            close(row.episode)
    if anew:
        initialise(m, 0, z.x_m, z.v_mps, p.r_x, p.r_v, p.a_var)
        row.rejections = 0
        close(row.episode)
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    verdict.nis = nis
    verdict.statistic = nis
    verdict.gate = p.gate
    verdict.p_value = exp(-0.5 * nis)
    verdict.nu[0], verdict.nu[1] = nu_x, nu_v
    verdict.S[0, 0], verdict.S[0, 1], verdict.S[1, 0], verdict.S[1, 1] = s_xx, s_xv, s_xv, s_vv
    verdict.x_m, verdict.v_mps = m[PX, 0], m[VX, 0]
    verdict.x_std_m, verdict.v_std_mps = sqrt(m[XX, 0]), sqrt(m[VV, 0])


@njit(cache=True, error_model="numpy")
def step_batch(bank: Any, rows: Any, readings: Any, p: CaParams, verdicts: Any) -> None:
    """`step_row` for each of the distinct `rows` (B,), with `readings` and `verdicts` (B,): one call for a batch."""
    for i in range(rows.size):
        step_row(bank[rows[i]], readings[i], p, verdicts[i])
