"""What the filter keeps of one vehicle in each mode, where it works on it, and the estimate over all modes."""

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.imm.modes import (
    DOUBLE_COLUMNS,
    DOUBLE_OFFSET_COLUMNS,
    DRIFT,
    HEALTHY,
    MODE_COUNT,
    NOISE,
    SINGLE_COLUMNS,
    SINGLE_FAULT_MODES,
    SINGLE_OFFSETS,
    SPARE_COLUMN,
    sensor_fault_probability,
)
from headway.core.estimation.kinematics import (
    AA,
    AX,
    BB,
    PX,
    SIZE,
    SS,
    VA,
    VV,
    VX,
    XA,
    XV,
    XX,
    Z_POSITION,
    Z_SPEED,
    clear_offset,
    copy_column,
    filters,
    initialise,
)

MODE_PROBABILITY_FLOOR = 1e-10
"""No mode is ever given up; log odds stay within +-23."""
PRUNE_DOUBLES_ABOVE = 0.9997
"""Probability of HEALTHY above which modes with two faults are not updated (ADR 0005, "Ends count")."""

SPEED_MAX_MPS, APART_MAX_M = 200.0, 1_000.0
"""Speed of a mode, and its distance from the most probable one, from which it has diverged: J2735 ends at 163.8 m/s."""
EXCLUDED_MPS, EXCLUDED_APART_M = (-5.0, 75.0), 20.0
"""The same for a mode with two faults that the readings exclude: speeds of a car, and its distance from where it is."""

MODES = np.dtype(
    [
        ("single", "f8", (SIZE, SINGLE_FAULT_MODES)),
        ("double", "f8", (SIZE, DOUBLE_COLUMNS)),
        ("mode_probability", "f8", (MODE_COUNT,)),
        ("manoeuvring", "f8"),  # probability that the newest reading belongs to a manoeuvre, given HEALTHY
    ],
    align=True,
)
"""One vehicle between two readings: the filters with at most one fault, those with two, and all probabilities.

`double` is up to date only while the probability of HEALTHY is at most PRUNE_DOUBLES_ABOVE. Otherwise nothing reads it,
and it is zero, except after a reset: words that are zero take no memory in evidence and snapshots.
"""

IMM_WORKSPACE = np.dtype(
    [
        ("single", filters(SINGLE_COLUMNS)),
        ("onset", filters(SINGLE_COLUMNS)),  # branches of HEALTHY: a fault or a manoeuvre begins
        ("recovered", filters(MODE_COUNT)),  # each mode as if its faults had ended
        ("double", filters(DOUBLE_COLUMNS)),
        ("predicted_probability", "f8", (MODE_COUNT,)),
        ("onset_share", "f8", (SINGLE_COLUMNS,)),  # share of the onset branch in its mode after the reading
        ("ended_probability", "f8", (MODE_COUNT,)),  # of: this mode held until the last reading, and HEALTHY holds now
        ("nu", "f8", (2,)),  # innovation of position and speed under HEALTHY
        ("S", "f8", (3,)),  # its covariance xx, xv, vv
        ("nis", "f8"),  # nu' S^-1 nu
    ],
    align=True,
)
"""What `update` works in, and its results `ended_probability`, `nu`, `S`, `nis`."""


class ModeParams(NamedTuple):
    """Prior knowledge of faults and motion; SI units. Values without another source: tuned on the pairs, ADR 0005."""

    faults_per_s: float = 0.0012
    """Rate at which one sensor becomes faulty, 1/s."""
    fault_s: float = 1.0
    """Mean duration of a fault, s: that of Algorithm 1 (1 to 20 readings at 10 Hz)."""
    manoeuvre_jerk: float = 90.0
    """Jerk density in a manoeuvre, as a multiple of the vehicle's usual one."""
    manoeuvre_jerk_min: float = 15.0
    """Added to it, m^2/s^5: a driver who was steady for long brakes as hard as others. A jerk of 12 m/s^3 in 0.1 s."""
    standstill_mps: float = 0.6
    """Speed below which the reported speed jumps, m/s: some sensors read 0 below about 0.4 m/s (ADR 0005)."""
    fault_size: float = 0.3
    """Scale of a fault, m or m/s; its Student's t distribution has heavy tails."""
    drift_offset0: float = 0.1
    """Standard deviation of the offset at the onset of a drift, m or m/s."""
    drift_slope0: float = 0.3
    """Standard deviation of its slope, m/s or m/s^2."""
    drift_slope_share: float = 0.1
    """Share of the squared slope of the first innovation, added to that variance (ADR 0005)."""
    offset_noise: float = 0.005
    """Standard deviation of an offset about its straight line, per reading, m or m/s."""
    a_std_mps2: float = 2.0
    """Standard deviation of the acceleration at the first reading, m/s^2."""


@njit(cache=True, error_model="numpy")
def initialise_modes(row: Any, x_m: float, v_mps: float, r: Any, p: ModeParams) -> None:
    """Initialise all modes of a row (MODES) at a reading of variances `r` (2,), with HEALTHY certain."""
    for j in range(SINGLE_FAULT_MODES):
        initialise(row.single, j, x_m, v_mps, r[Z_POSITION], r[Z_SPEED], p.a_std_mps2**2)
    row.double[:] = 0.0
    row.mode_probability[:] = MODE_PROBABILITY_FLOOR
    row.mode_probability[HEALTHY] = 1.0
    row.manoeuvring = 0.0


@njit(cache=True, error_model="numpy")
def add_means(m: Any, mu: Any, first: int, last: int, into: Any) -> None:
    """Add mu_j times the mean of each mode j from `first` to `last`; mode j is column j - `first` of m."""
    for j in range(first, last):
        for i in (PX, VX, AX):
            into[i] += mu[j] * m[i, j - first]


@njit(cache=True, error_model="numpy")
def add_covariances(m: Any, mu: Any, first: int, last: int, into: Any) -> None:
    """Add mu_j (P_j + d_j d_j') of the same modes, d_j being the distance of mean j from the mean in `into`."""
    for j in range(first, last):
        k = j - first
        dx, dv, da = m[PX, k] - into[PX], m[VX, k] - into[VX], m[AX, k] - into[AX]
        into[XX] += mu[j] * (m[XX, k] + dx * dx)
        into[XV] += mu[j] * (m[XV, k] + dx * dv)
        into[XA] += mu[j] * (m[XA, k] + dx * da)
        into[VV] += mu[j] * (m[VV, k] + dv * dv)
        into[VA] += mu[j] * (m[VA, k] + dv * da)
        into[AA] += mu[j] * (m[AA, k] + da * da)


@njit(cache=True, error_model="numpy")
def estimate(row: Any, into: Any) -> None:
    """Write mean and covariance of the motion over all modes, without any offset, to `into` (SIZE,)."""
    into[:] = 0.0
    with_doubles = row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE
    add_means(row.single, row.mode_probability, 0, SINGLE_FAULT_MODES, into)
    if with_doubles:
        add_means(row.double, row.mode_probability, SINGLE_FAULT_MODES, MODE_COUNT, into)
    add_covariances(row.single, row.mode_probability, 0, SINGLE_FAULT_MODES, into)
    if with_doubles:
        add_covariances(row.double, row.mode_probability, SINGLE_FAULT_MODES, MODE_COUNT, into)


@njit(cache=True, error_model="numpy")
def load(row: Any, imm: Any, doubles_pruned: bool) -> None:
    """Copy the filters of the row into the workspace."""
    for i in range(SIZE):
        for j in range(SINGLE_FAULT_MODES):
            imm.single.m[i, j] = row.single[i, j]
        imm.single.m[i, SPARE_COLUMN] = row.single[i, HEALTHY]
    if not doubles_pruned:
        imm.double.m[:] = row.double


@njit(cache=True, error_model="numpy")
def store(row: Any, imm: Any, doubles_pruned: bool) -> None:
    """Copy them back. Modes with two faults that were pruned until now start from HEALTHY."""
    for i in range(SIZE):
        for j in range(SINGLE_FAULT_MODES):
            row.single[i, j] = imm.single.m[i, j]
    if row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE:
        for j in range(DOUBLE_COLUMNS):
            if doubles_pruned:
                copy_column(row.double, j, imm.single.m, HEALTHY)
            else:
                copy_column(row.double, j, imm.double.m, j)
    elif not doubles_pruned:
        row.double[:] = 0.0


@njit(cache=True, error_model="numpy")
def save_prior(imm: Any, count: int) -> None:
    """Copy the first `count` modes to `recovered`, without their offsets."""
    recovered = imm.recovered.m
    for j in range(SINGLE_FAULT_MODES):
        copy_column(recovered, j, imm.single.m, j)
    for j in range(SINGLE_FAULT_MODES, count):
        copy_column(recovered, j, imm.double.m, j - SINGLE_FAULT_MODES)
    for j in range(count):
        clear_offset(recovered, j)


@njit(cache=True, error_model="numpy")
def restart_from(row: Any, mode: int, m: Any, j: int) -> None:
    """Overwrite column j of m by a mode of the row, without its offset."""
    if mode < SINGLE_FAULT_MODES:
        copy_column(m, j, row.single, mode)
    else:
        copy_column(m, j, row.double, mode - SINGLE_FAULT_MODES)
    clear_offset(m, j)


@njit(cache=True, error_model="numpy")
def restart_diverged(row: Any, p: ModeParams) -> None:
    """Restart each mode of a row that no car can be in from the most probable mode, its offset unknown.

    A mode that the readings exclude keeps the floor of the probabilities. Nothing holds its state: where both sensors
    scatter by metres for long, mixing with others of its sort widens it at each reading, until its mean is no number.
    Once a reading excludes the others, such a mode would be the estimate.
    """
    likeliest, single, double = int(np.argmax(row.mode_probability)), row.single, row.double
    x_m = single[PX, likeliest] if likeliest < SINGLE_FAULT_MODES else double[PX, likeliest - SINGLE_FAULT_MODES]
    for j in range(SINGLE_FAULT_MODES):
        if not (abs(single[VX, j]) < SPEED_MAX_MPS and abs(single[PX, j] - x_m) < APART_MAX_M):
            restart_from(row, likeliest, single, j)
            single[BB, j] = 2.0 * p.fault_size**2 if j in SINGLE_OFFSETS else 0.0
            single[SS, j] = p.drift_slope0**2 if j in DRIFT else 0.0
    if row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE:
        for k in range(DOUBLE_COLUMNS):
            v_mps, apart_m = double[VX, k], abs(double[PX, k] - x_m)
            is_possible = abs(v_mps) < SPEED_MAX_MPS and apart_m < APART_MAX_M
            if row.mode_probability[SINGLE_FAULT_MODES + k] <= MODE_PROBABILITY_FLOOR:
                is_possible = EXCLUDED_MPS[0] < v_mps < EXCLUDED_MPS[1] and apart_m < EXCLUDED_APART_M
            if not is_possible:
                restart_from(row, likeliest, double, k)
                if k in DOUBLE_OFFSET_COLUMNS:
                    double[BB, k], double[SS, k] = 2.0 * p.fault_size**2, p.drift_slope0**2


@njit(cache=True, error_model="numpy")
def add_acceleration_change(row: Any, change_mps2: float) -> None:
    """Add a known change of acceleration, the input of the motion model, to every mode."""
    for j in range(SINGLE_FAULT_MODES):
        row.single[AX, j] += change_mps2
    if row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE:
        for j in range(DOUBLE_COLUMNS):
            row.double[AX, j] += change_mps2


@njit(cache=True, error_model="numpy")
def reset_to_measurement(row: Any, position: bool, speed: bool, mean: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Reset `position`, `speed` or both to the reading `z` of variances `r`, and all modes to the estimate `mean`.

    A faulty sensor that is not reset keeps its fault.
    """
    mu = row.mode_probability
    position_fault, speed_fault = sensor_fault_probability(mu)
    if position:
        mean[PX], mean[XX], mean[XV], mean[XA] = z[Z_POSITION], r[Z_POSITION], 0.0, 0.0
    if speed:
        mean[VX], mean[VV], mean[XV], mean[VA] = z[Z_SPEED], r[Z_SPEED], 0.0, 0.0
        mean[AX], mean[XA], mean[AA] = 0.0, 0.0, p.a_std_mps2**2
    for j in range(SINGLE_FAULT_MODES):
        row.single[:, j] = mean
    for j in range(DOUBLE_COLUMNS):
        row.double[:, j] = mean
    mu[:] = MODE_PROBABILITY_FLOOR
    if speed_fault > 0.5 and not speed:
        mu[NOISE[Z_SPEED]] = 1.0
    elif position_fault > 0.5 and not position:
        mu[NOISE[Z_POSITION]] = 1.0
    else:
        mu[HEALTHY] = 1.0
