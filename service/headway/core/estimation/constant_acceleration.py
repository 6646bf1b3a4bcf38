"""The baseline model `ca`: one vehicle alone, x' = v, v' = a, a' = white jerk; no leader, no delay, one gate.

Both readings update the filter, or both are rejected if nis exceeds the chi-square gate, and the prediction stands.
"""

from math import sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.delayed_ekf import SENSOR_SPEED, isolate, write_test
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
from headway.core.statistics.chi_square import chi_square_gate
from headway.core.statistics.fault_shape import EPISODE, add_deviation, end_episode, likeliest_kind
from headway.core.statistics.innovation import Innovation, nis_2d
from headway.core.types.config import DetectorConfig

NOMINAL_HZ = 10.0
"""Message rate of SAE J2945/1 without congestion."""
CA = np.dtype(
    [
        ("count", "i8"),  # readings; 0: a row that is not initialised
        ("t_s", "f8"),
        ("estimate", filters(1)),  # as in `kinematics`, without an offset
        ("rejections", "i8"),  # in a row, up to now
        ("episode", EPISODE),  # of the readings rejected in a row
    ],
    align=True,
)


class CaParams(NamedTuple):
    """Numbers of the model, the same for every vehicle."""

    gate: float
    """Threshold of nis."""
    sensor_gate: float
    """Threshold of one sensor's own squared, normalised innovation."""
    max_gap_s: float
    """A longer silence initialises the filter again."""
    warming_readings: int
    rejections_max: int = 30
    """Rejections in a row after which the filter is initialised at the reading."""
    r_x: float = 4e-4
    r_v: float = 4e-4
    """Variances of a reading, m^2 and (m/s)^2: twice the noise of the published experiment, 0.01."""
    jerk: float = 0.3
    """Density of white jerk, m^2/s^5: the start of the default model's adaptation."""
    a_var: float = 1.0
    """Variance of the acceleration at the first reading, (m/s^2)^2."""


def ca_params(config: DetectorConfig) -> CaParams:
    """Return the chi-square gates for the alarm budget, at 10 Hz and with Gaussian noise."""
    share = min(0.5, config.alarm_budget_per_hour / (3600.0 * NOMINAL_HZ))
    return CaParams(
        gate=chi_square_gate(2, share),
        sensor_gate=chi_square_gate(1, share),
        max_gap_s=config.max_gap_s,
        warming_readings=config.warming_readings,
    )


@njit(cache=True, error_model="numpy")
def reject(row: Any, innovation: Innovation, p: CaParams, verdict: Any) -> None:
    """Write sensor and kind of a rejected reading."""
    verdict.sensor = isolate(innovation, p.sensor_gate)
    if verdict.sensor == SENSOR_SPEED:
        add_deviation(row.episode, innovation.nu_v)
        verdict.kind, verdict.confidence = likeliest_kind(row.episode, p.r_v)
    else:
        add_deviation(row.episode, innovation.nu_x)
        verdict.kind, verdict.confidence = likeliest_kind(row.episode, p.r_x)


@njit(cache=True, error_model="numpy")
def step_row(row: Any, z: Any, p: CaParams, verdict: Any) -> None:
    """Update one row (CA) by one READING, in place, and write the VERDICT."""
    m = row.estimate.m
    dt_s = z.t_s - row.t_s
    row.t_s = z.t_s
    innovation = Innovation(0.0, 0.0, p.r_x, 0.0, p.r_v, 0.0)
    restart = row.count == 0 or dt_s > p.max_gap_s
    if restart:
        verdict.restarted = row.count > 0
        row.count = 0
    else:
        predict(row.estimate, dt_s, p.jerk, 0.0)
        nu_x, nu_v = z.x_m - m[PX, 0], z.v_mps - m[VX, 0]
        s_xx, s_xv, s_vv = m[XX, 0] + p.r_x, m[XV, 0], m[VV, 0] + p.r_v
        innovation = Innovation(nu_x, nu_v, s_xx, s_xv, s_vv, nis_2d(nu_x, nu_v, s_xx, s_xv, s_vv, p.r_v))
        verdict.anomalous = row.count >= p.warming_readings and innovation.nis > p.gate
        if verdict.anomalous:
            reject(row, innovation, p, verdict)
            row.rejections += 1
            restart = row.rejections >= p.rejections_max
            verdict.restarted = restart
        else:
            update_scalar(row.estimate, Z_POSITION, z.x_m, p.r_x, 0.0, NO_ROLES)
            update_scalar(row.estimate, Z_SPEED, z.v_mps, p.r_v, 0.0, NO_ROLES)
            row.rejections = 0
            end_episode(row.episode)
    if restart:
        initialise(m, 0, z.x_m, z.v_mps, p.r_x, p.r_v, p.a_var)
        row.rejections = 0
        end_episode(row.episode)
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    write_test(verdict, innovation, p.gate)
    verdict.x_m, verdict.v_mps = m[PX, 0], m[VX, 0]
    verdict.x_std_m, verdict.v_std_mps = sqrt(m[XX, 0]), sqrt(m[VV, 0])


@njit(cache=True, error_model="numpy")
def step_batch(bank: Any, rows: Any, readings: Any, p: CaParams, verdicts: Any) -> None:
    """`step_row` for each of the distinct `rows` (B,), with `readings` and `verdicts` (B,): one call for a batch."""
    for i in range(rows.size):
        step_row(bank[rows[i]], readings[i], p, verdicts[i])
