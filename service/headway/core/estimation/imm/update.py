"""One reading through all modes: predict, mix along the Markov chain, update, and weigh.

The interacting-multiple-model filter (Blom and Bar-Shalom 1988, doi:10.1109/9.1299) of the modes in `modes`. With mu_j
the probability of mode j and Lambda_j the likelihood of the reading in it,

    mu_j^-  = sum_i p(i -> j) mu_i                    column j: moment match of what arrives there
    mu_j    = mu_j^- Lambda_j / sum_k mu_k^- Lambda_k

Three branches are moment matched only after the reading (generalised pseudo-Bayesian filter of second order, Ackerson
and Fu 1970, doi:10.1109/TAC.1970.1099359):

    a fault begins           its offset is set from this reading
    a manoeuvre begins       HEALTHY with more jerk, and a jump of the speed near standstill
    a fault ends             a fault that HEALTHY had followed unnoticed shows only in the reading that returns

The last matters only if HEALTHY is in doubt, and modes with two faults likewise; both are pruned otherwise.
"""

from math import exp, isfinite
from typing import Any, NamedTuple

from numba import njit

from headway.core.estimation.imm.modes import (
    BIAS,
    DOUBLE_COLUMNS,
    DOUBLE_OFFSET_COLUMNS,
    DOUBLE_ROLES,
    DRIFT,
    HEALTHY,
    MODE_COUNT,
    ONSET_ROLES,
    POSITION_HEALTHY,
    SECOND_FAULT_BEGINS,
    SECOND_FAULT_ENDS,
    SINGLE_COLUMNS,
    SINGLE_FAULT_MODES,
    SINGLE_FAULTS,
    SINGLE_OFFSETS,
    SINGLE_ROLES,
    SPARE_COLUMN,
    SPEED_HEALTHY,
    Chances,
    transition_chances,
)
from headway.core.estimation.imm.state import (
    MODE_PROBABILITY_FLOOR,
    PRUNE_DOUBLES_ABOVE,
    ModeParams,
    load,
    restart_diverged,
    save_prior,
    store,
)
from headway.core.estimation.kinematics import (
    BB,
    NO_ROLES,
    PX,
    SIZE,
    SS,
    VV,
    VX,
    XV,
    XX,
    Z_POSITION,
    Z_SPEED,
    add_jerk_noise,
    add_speed_jump,
    copy_column,
    likelihood,
    moment_match,
    moment_match_weighted,
    predict,
    repair_covariance,
    reset_likelihood,
    set_offset,
    update_scalar,
)
from headway.core.statistics.innovation import nis_2d
from headway.core.types.records import Sensor

ONSET_KINDS = 3.0
"""A fault begins as bias, drift or noise with equal probability, as in MODE_TABLE."""
FAULT_PROBABILITY_MAX = 0.1
"""Of a sensor in one interval, however long."""
PRUNE_RECOVERY_BELOW_NIS = 9.0
"""nis of HEALTHY below which the end of a fault is not weighed (ADR 0005, "Ends count")."""
IMPLAUSIBLE_LIKELIHOOD = 1e-8
"""Likelihood factor of a healthy sensor whose reading breaks a physical limit."""
POSITION_FAULT, SPEED_FAULT = int(Sensor.LOCATION) | int(Sensor.HEADING), int(Sensor.SPEED)
"""`Sensor` flags that concern each of them."""
NEGATIVE_SPEED_STD = 5.0
"""Standard deviations below zero from which noise does not explain the reading."""
PROBABILITY_TINY = 1e-280
"""Keeps the share of an onset finite where both likelihoods underflow."""


class Motion(NamedTuple):
    """Noise of the motion between two readings."""

    jerk_density: float
    """m^2/s^5, outside manoeuvres."""
    random_walk_density: float
    """m^2/s: the position wanders against the integral of the speed."""
    manoeuvre: float
    """Probability that a reading belongs to a manoeuvre of a driver without a leader."""
    unexplained: float
    """Share of the driver's manoeuvres that the leader does not explain."""
    dead_zone_mps: float
    """Speed below which the sensor reports 0."""


@njit(cache=True, error_model="numpy")
def mix(row: Any, chances: Chances, p: ModeParams, imm: Any) -> None:
    """Mix the faulty modes: columns and `predicted_probability` become those before the reading.

    The row and `recovered` hold the modes after the last reading, the second without offsets. After NOISE an
    offset is unknown, so it starts with the variance of a fault.
    """
    single, double, recovered = imm.single.m, imm.double.m, imm.recovered.m
    mu, predicted = row.mode_probability, imm.predicted_probability
    for j in range(SINGLE_FAULT_MODES, MODE_COUNT):
        predicted[j] = mu[j] * chances.keep_double
    for target, source, share, chance, new_offset in SECOND_FAULT_BEGINS:
        weight = share * mu[source] * chances.mixing[chance]
        column = source
        if new_offset:
            copy_column(single, SPARE_COLUMN, single, source)
            single[BB, SPARE_COLUMN], single[SS, SPARE_COLUMN] = 2.0 * p.fault_size**2, p.drift_slope0**2
            column = SPARE_COLUMN
        predicted[target] = moment_match_weighted(
            double, target - SINGLE_FAULT_MODES, predicted[target], single, column, weight
        )
    for target, source, share, chance, keeps_offset in SECOND_FAULT_ENDS:
        weight = share * mu[source] * chances.mixing[chance]
        if keeps_offset:
            predicted[target] = moment_match_weighted(
                single, target, predicted[target], row.double, source - SINGLE_FAULT_MODES, weight
            )
        else:
            predicted[target] = moment_match_weighted(single, target, predicted[target], recovered, source, weight)


@njit(cache=True, error_model="numpy")
def manoeuvre_jerk(motion: Motion, p: ModeParams) -> float:
    """Return the jerk density of a manoeuvre, less that of other motion."""
    return motion.jerk_density * (p.manoeuvre_jerk - 1.0) + motion.unexplained * p.manoeuvre_jerk_min


@njit(cache=True, error_model="numpy")
def branch_to_faults(imm: Any, dt_s: float, motion: Motion, p: ModeParams) -> None:
    """Fill the onset branches from the predicted HEALTHY: a fault or a manoeuvre begins with this reading."""
    m, single = imm.onset.m, imm.single.m
    for i in range(SIZE):
        healthy = single[i, HEALTHY]
        for j in range(SINGLE_COLUMNS):
            m[i, j] = healthy
    add_jerk_noise(m, HEALTHY, dt_s, manoeuvre_jerk(motion, p))
    slow = exp(-0.5 * (m[VX, HEALTHY] / p.standstill_mps) ** 2)
    add_speed_jump(m, HEALTHY, dt_s, motion.dead_zone_mps**2 * slow)
    for sensor in (Z_POSITION, Z_SPEED):
        drift = DRIFT[sensor]
        m[BB, drift] = p.drift_offset0**2
        m[SS, drift] = p.drift_slope0**2 + p.drift_slope_share * (imm.nu[sensor] / dt_s) ** 2


@njit(cache=True, error_model="numpy")
def update_single_faults(imm: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Update the modes with at most one fault, and their onset branches, by the reading; speed first."""
    single, onset = imm.single, imm.onset
    reset_likelihood(single)
    reset_likelihood(onset)
    for sensor in (Z_SPEED, Z_POSITION):
        if isfinite(r[sensor]):
            update_scalar(single, sensor, z[sensor], r[sensor], p.fault_size, SINGLE_ROLES[sensor])
            update_scalar(onset, sensor, z[sensor], r[sensor], p.fault_size, ONSET_ROLES[sensor])
    for sensor in (Z_POSITION, Z_SPEED):
        if isfinite(r[sensor]):
            set_offset(onset.m, BIAS[sensor], sensor, z[sensor], r[sensor])


@njit(cache=True, error_model="numpy")
def update_double_faults(imm: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Update the modes with two faults by the reading, and weigh them by its likelihood."""
    double = imm.double
    reset_likelihood(double)
    for sensor in (Z_SPEED, Z_POSITION):
        if isfinite(r[sensor]):
            update_scalar(double, sensor, z[sensor], r[sensor], p.fault_size, DOUBLE_ROLES[sensor])
    for j in range(DOUBLE_COLUMNS):
        imm.predicted_probability[SINGLE_FAULT_MODES + j] *= likelihood(double, j)


@njit(cache=True, error_model="numpy")
def weigh_single_faults(row: Any, onset: float, r: Any, motion: Motion, imm: Any) -> None:
    """Weigh the modes with at most one fault by the reading's likelihood, and moment match their onset branches.

    A fault of a sensor that has no reading does not begin.
    """
    predicted, healthy_probability = imm.predicted_probability, row.mode_probability[HEALTHY]
    onset_probability = healthy_probability * onset / ONSET_KINDS
    manoeuvre = motion.unexplained * motion.manoeuvre
    manoeuvring = predicted[HEALTHY] * manoeuvre
    predicted[HEALTHY] *= 1.0 - manoeuvre
    for j in range(SINGLE_FAULT_MODES):
        arriving = (manoeuvring if j == HEALTHY else onset_probability) * likelihood(imm.onset, j)
        if j in SINGLE_FAULTS[Z_POSITION] and not isfinite(r[Z_POSITION]):
            arriving = 0.0
        predicted[j] = predicted[j] * likelihood(imm.single, j) + arriving + PROBABILITY_TINY
        imm.onset_share[j] = arriving / predicted[j]
    row.manoeuvring = imm.onset_share[HEALTHY]
    single, onset, share = imm.single.m, imm.onset.m, imm.onset_share
    for j in range(SINGLE_COLUMNS):
        moment_match(single, j, onset, j, share[j])


@njit(cache=True, error_model="numpy")
def branch_to_healthy(row: Any, end: float, count: int, z: Any, r: Any, imm: Any) -> None:
    """Weigh for each of the first `count` modes that its faults have just ended, and moment match it into HEALTHY."""
    recovered, ended = imm.recovered, imm.ended_probability
    reset_likelihood(recovered)
    for sensor in (Z_SPEED, Z_POSITION):
        if isfinite(r[sensor]):
            update_scalar(recovered, sensor, z[sensor], r[sensor], 0.0, NO_ROLES)
    weight = imm.predicted_probability[HEALTHY]
    for j in range(1, count):
        ended[j] = row.mode_probability[j] * (end if j < SINGLE_FAULT_MODES else end**2) * likelihood(recovered, j)
        weight = moment_match_weighted(imm.single.m, HEALTHY, weight, recovered.m, j, ended[j])
    imm.predicted_probability[HEALTHY] = weight


@njit(cache=True, error_model="numpy")
def innovate(z: Any, r: Any, imm: Any) -> None:
    """Write innovation, covariance and nis of the reading under the predicted HEALTHY.

    Without a position, its innovation is 0 and its covariance that of the prediction.
    """
    m, nu, cov = imm.single.m, imm.nu, imm.S
    nu[Z_POSITION], nu[Z_SPEED] = z[Z_POSITION] - m[PX, HEALTHY], z[Z_SPEED] - m[VX, HEALTHY]
    cov[0], cov[1], cov[2] = m[XX, HEALTHY] + r[Z_POSITION], m[XV, HEALTHY], m[VV, HEALTHY] + r[Z_SPEED]
    if not isfinite(r[Z_POSITION]):
        nu[Z_POSITION], cov[0] = 0.0, m[XX, HEALTHY]
    imm.nis = nis_2d(nu[Z_POSITION], nu[Z_SPEED], cov[0], cov[1], cov[2], r[Z_SPEED])


@njit(cache=True, error_model="numpy")
def weigh_limits(z: Any, r: Any, implausible: int, imm: Any) -> None:
    """Weigh the modes by physical limits: those that `implausible` breaks, and that a speed is not negative."""
    predicted = imm.predicted_probability
    if implausible & POSITION_FAULT:
        for j in POSITION_HEALTHY:
            predicted[j] *= IMPLAUSIBLE_LIKELIHOOD
    if implausible & SPEED_FAULT or z[Z_SPEED] < -NEGATIVE_SPEED_STD * r[Z_SPEED] ** 0.5:
        for j in SPEED_HEALTHY:
            predicted[j] *= IMPLAUSIBLE_LIKELIHOOD
    if implausible & (POSITION_FAULT | SPEED_FAULT):
        imm.ended_probability[:] = 0.0


@njit(cache=True, error_model="numpy")
def normalise(row: Any, imm: Any) -> None:
    """Write the mode probabilities, which sum to 1 and stay above their floor."""
    predicted = imm.predicted_probability
    total = predicted.sum()
    for j in range(MODE_COUNT):
        row.mode_probability[j] = max(predicted[j] / total, MODE_PROBABILITY_FLOOR)
        imm.ended_probability[j] /= total


@njit(cache=True, error_model="numpy")
def update(row: Any, dt_s: float, z: Any, r: Any, motion: Motion, implausible: int, p: ModeParams, imm: Any) -> bool:
    """Update a row (MODES) by one reading, `dt_s` after the last; return whether a covariance was repaired.

    Parameters
    ----------
    z, r
        (2,) reading of position and speed, and its variances; infinite for a position that was not measured again.
    implausible
        `Sensor` whose reading breaks a physical limit: it is faulty whatever the motion is.
    imm
        Workspace (IMM_WORKSPACE), which also holds the results `ended_probability`, `nu`, `S` and `nis`.
    """
    mu, predicted, single = row.mode_probability, imm.predicted_probability, imm.single.m
    onset = min(FAULT_PROBABILITY_MAX, p.faults_per_s * dt_s)
    chances = transition_chances(onset, 1.0 - exp(-dt_s / p.fault_s))
    doubles_pruned = mu[HEALTHY] > PRUNE_DOUBLES_ABOVE
    # The manoeuvre that the last reading left possible widens HEALTHY; modes that it did not widen would gain by it.
    manoeuvring = min(row.manoeuvring, motion.unexplained * motion.manoeuvre)
    faulty_jerk_density = motion.jerk_density + manoeuvring * manoeuvre_jerk(motion, p)
    load(row, imm, doubles_pruned)
    predicted[HEALTHY] = mu[HEALTHY] * (1.0 - 2.0 * onset)  # begin^2 is mixed apart
    for j in range(1, SINGLE_FAULT_MODES):
        predicted[j] = mu[j] * (1.0 - chances.end) * (1.0 - onset)
    predicted[SINGLE_FAULT_MODES:] = 0.0
    if not doubles_pruned:
        save_prior(imm, MODE_COUNT)
        mix(row, chances, p, imm)
        predict(imm.recovered, dt_s, faulty_jerk_density, motion.random_walk_density)
        predict(imm.double, dt_s, faulty_jerk_density, motion.random_walk_density)
        for j in DOUBLE_OFFSET_COLUMNS:
            imm.double.m[BB, j] += p.offset_noise**2
    predict(imm.single, dt_s, motion.jerk_density, motion.random_walk_density)
    for j in range(1, SINGLE_FAULT_MODES):
        add_jerk_noise(single, j, dt_s, faulty_jerk_density - motion.jerk_density)
    innovate(z, r, imm)
    recovery_pruned = doubles_pruned and imm.nis < PRUNE_RECOVERY_BELOW_NIS
    if doubles_pruned and not recovery_pruned:
        save_prior(imm, SINGLE_FAULT_MODES)
    branch_to_faults(imm, dt_s, motion, p)
    for j in SINGLE_OFFSETS:
        single[BB, j] += p.offset_noise**2
    update_single_faults(imm, z, r, p)
    weigh_single_faults(row, onset, r, motion, imm)
    imm.ended_probability[:] = 0.0
    if not recovery_pruned:
        branch_to_healthy(row, chances.end, SINGLE_FAULT_MODES if doubles_pruned else MODE_COUNT, z, r, imm)
    if not doubles_pruned:
        update_double_faults(imm, z, r, p)
    weigh_limits(z, r, implausible, imm)
    normalise(row, imm)
    repaired = repair_covariance(imm.single)
    if not doubles_pruned:
        repaired |= repair_covariance(imm.double)
    store(row, imm, doubles_pruned)
    restart_diverged(row, p)
    return repaired
