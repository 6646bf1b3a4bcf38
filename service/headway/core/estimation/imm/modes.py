"""Ten hypotheses about one vehicle's two sensors, weighed against each other reading by reading.

An interacting-multiple-model filter (Blom, Bar-Shalom 1988, doi:10.1109/9.1299): every hypothesis is a filter of its
own (`motion`), a Markov chain moves weight between them, and what arrives at a hypothesis is merged into one Gaussian.
Nobody lies in HEALTHY. For each sensor (location first, speed OTHER_SENSOR further on) three say how it alone lies,

    BIAS    by a constant offset               the other sensor is used; the offset is part of the state, so that
    DRIFT   by an offset that grows steadily   the differences of the lying readings still count
    NOISE   by anything, each time anew        the other sensor is used, this one not at all

and three say that both lie: PAIR, one sensor by an offset (location, or speed OTHER_PAIR further on) and the other by
anything; BOTH, either by anything. HEALTHY is followed calm or manoeuvring (more jerk; near standstill a jump of the
speed as well, for speed sensors read zero below some speed), merged after each reading.
A sensor goes bad with `faults_per_s` and is bad for `fault_s` on average, each sensor for itself.

On the ways between HEALTHY and the rest, Gaussians are merged only after the reading has spoken (the generalised
pseudo-Bayesian filter of second order, Ackerson and Fu 1970, doi:10.1109/TAC.1970.1099359). It has to set the offset
of a lie that begins; and the end of a lie that went unnoticed shows only in the one reading that comes back, where
HEALTHY, who had followed the liar, fails and he who had doubted it is right.
"""

from math import exp
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.kinematics import (
    AA,
    AX,
    BB,
    NO_COLUMN,
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
    add_jerk_noise,
    add_speed_jump,
    clear_offset,
    copy_column,
    filters,
    initialise,
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

HEALTHY, BIAS, DRIFT, NOISE = 0, 1, 2, 3
OTHER_SENSOR = 3
"""Added to one of the last three it means the speed sensor instead of the location."""
PAIR, BOTH = 7, 9
OTHER_PAIR = 1
SINGLE_FAULT_MODES, MODE_COUNT = 7, 10
"""Hypotheses below SINGLE are those of at most one lie."""
MODE_PROBABILITY_FLOOR = 1e-10
"""No hypothesis ever dies, and the log odds stay within +-23."""
IMPLAUSIBLE_LIKELIHOOD = 1e-8
_POSITION_FAULT, _SPEED_FAULT = int(Sensor.LOCATION) | int(Sensor.HEADING), int(Sensor.SPEED)
PRUNE_DOUBLES_ABOVE = 0.9997
"""Probability of HEALTHY beyond which nobody thinks of two lies at once,"""
PRUNE_RECOVERY_BELOW_NIS = 9.0
"""nor, if its nis is below this, of a lie that has just ended."""

SINGLE_COLUMNS = SINGLE_FAULT_MODES + 1
DOUBLE_COLUMNS = MODE_COUNT - SINGLE_FAULT_MODES
MODES = np.dtype(
    [
        ("single", "f8", (SIZE, SINGLE_COLUMNS)),
        ("double", "f8", (SIZE, DOUBLE_COLUMNS)),
        ("mode_probability", "f8", (MODE_COUNT,)),
    ],
    align=True,
)
"""What is kept of a vehicle between two readings: a weight for each hypothesis, and a lane.

`single` holds the modes with at most one fault and a spare column; `double` those with two, which change only while
the probability of HEALTHY is at most PRUNE_DOUBLES_ABOVE.
"""
SPARE_COLUMN = SINGLE_FAULT_MODES

BIAS_V, DRIFT_V, NOISE_V = BIAS + OTHER_SENSOR, DRIFT + OTHER_SENSOR, NOISE + OTHER_SENSOR
POSITION_OFFSET_COLUMN, SPEED_OFFSET_COLUMN, BOTH_NOISE_COLUMN = range(DOUBLE_COLUMNS)
"""Lanes of `double`."""

IMM_WORKSPACE = np.dtype(
    [
        ("single", filters(SINGLE_COLUMNS)),
        (
            "onset",
            filters(SINGLE_COLUMNS),
        ),  # what comes to each hypothesis from HEALTHY now: a lie begins, or a manoeuvre
        ("recovered", filters(MODE_COUNT)),  # each hypothesis as if its lie were over
        ("double", filters(DOUBLE_COLUMNS)),
        ("predicted_probability", "f8", (MODE_COUNT,)),
        ("onset_share", "f8", (SINGLE_COLUMNS,)),  # of the fresh lanes in what comes of both
        ("ended_probability", "f8", (MODE_COUNT,)),  # weight of: this hypothesis was true until now, and is over
        ("nu", "f8", (2,)),  # innovation of location and speed under HEALTHY,
        ("S", "f8", (3,)),  # and its covariance xx, xv, vv
        ("nis", "f8"),  # nu' S^-1 nu
    ],
    align=True,
)
"""What `update` works in, and answers with: `ended_probability`, `nu`, `S`, `nis`."""


class ModeParams(NamedTuple):
    """What is thought possible before any reading; SI units."""

    faults_per_s: float
    fault_s: float
    manoeuvre: float
    """Probability that a reading belongs to a manoeuvre."""
    manoeuvre_jerk: float
    """Density of the jerk then, as a multiple of the calm one,"""
    manoeuvre_jerk_min: float
    """and on top of that, m^2/s^5: whoever drove steadily for long brakes as hard as others do."""
    standstill_mps: float
    """Below about this speed it may seem to jump,"""
    standstill_jump_mps: float
    """by about this much."""
    fault_size: float
    """Usual size of a fault, m or m/s; the tails are heavy."""
    drift_offset0: float
    drift_slope0: float
    """Usual offset at the start of a drift, and its growth per second;"""
    drift_slope_share: float
    """of the slope that the first innovation would mean, this share (of the variance) is thought possible as well."""
    offset_noise: float
    """How far an offset strays from its straight line, per reading."""
    a_std_mps2: float
    """How well the acceleration of a vehicle not heard before is known."""


@njit(cache=True, error_model="numpy")
def initialise_modes(row: Any, x_m: float, v_mps: float, r: Any, p: ModeParams) -> None:
    """Start every hypothesis of a row (HYPOTHESES) at a reading of variances `r` (2,), and believe it."""
    for j in range(SINGLE_COLUMNS):
        initialise(row.single, j, x_m, v_mps, r[Z_POSITION], r[Z_SPEED], p.a_std_mps2**2)
    row.mode_probability[:] = MODE_PROBABILITY_FLOOR
    row.mode_probability[HEALTHY] = 1.0


@njit(cache=True, error_model="numpy")
def add_means(m: Any, mode_probability: Any, first: int, last: int, into: Any) -> None:
    """Add up the means of hypotheses `first` to `last`, which are lanes 0, 1, ... of m."""
    for j in range(first, last):
        for i in (PX, VX, AX):
            into[i] += mode_probability[j] * m[i, j - first]


@njit(cache=True, error_model="numpy")
def add_covariances(m: Any, mode_probability: Any, first: int, last: int, into: Any) -> None:
    """Add up the covariances of the same, about the mean that is in `into` by now."""
    for j in range(first, last):
        k = j - first
        dx, dv, da = m[PX, k] - into[PX], m[VX, k] - into[VX], m[AX, k] - into[AX]
        into[XX] += mode_probability[j] * (m[XX, k] + dx * dx)
        into[XV] += mode_probability[j] * (m[XV, k] + dx * dv)
        into[XA] += mode_probability[j] * (m[XA, k] + dx * da)
        into[VV] += mode_probability[j] * (m[VV, k] + dv * dv)
        into[VA] += mode_probability[j] * (m[VA, k] + dv * da)
        into[AA] += mode_probability[j] * (m[AA, k] + da * da)


@njit(cache=True, error_model="numpy")
def estimate(row: Any, into: Any) -> None:
    """Write mean and covariance of the car's own motion, over all hypotheses and without any lie, to `into` (SIZE,)."""
    into[:] = 0.0
    doubles_pruned = row.mode_probability[HEALTHY] > PRUNE_DOUBLES_ABOVE
    add_means(row.single, row.mode_probability, 0, SINGLE_FAULT_MODES, into)
    if not doubles_pruned:
        add_means(row.double, row.mode_probability, SINGLE_FAULT_MODES, MODE_COUNT, into)
    add_covariances(row.single, row.mode_probability, 0, SINGLE_FAULT_MODES, into)
    if not doubles_pruned:
        add_covariances(row.double, row.mode_probability, SINGLE_FAULT_MODES, MODE_COUNT, into)


@njit(cache=True, error_model="numpy")
def load(row: Any, found: Any, doubles_pruned: bool) -> None:
    """Copy lanes of the row to where they are worked on."""
    for i in range(SIZE):
        for j in range(SINGLE_COLUMNS):
            found.single.m[i, j] = row.single[i, j]
    if not doubles_pruned:
        found.double.m[:] = row.double


@njit(cache=True, error_model="numpy")
def store(row: Any, found: Any, doubles_pruned: bool) -> None:
    """Copy them back; hypotheses of two lies that nobody thought of until now know what HEALTHY knows."""
    for i in range(SIZE):
        for j in range(SINGLE_COLUMNS):
            row.single[i, j] = found.single.m[i, j]
    if row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE:
        for j in range(DOUBLE_COLUMNS):
            if doubles_pruned:
                copy_column(row.double, j, found.single.m, HEALTHY)
            else:
                copy_column(row.double, j, found.double.m, j)


@njit(cache=True, error_model="numpy")
def save_prior(found: Any, count: int) -> None:
    """Keep the first `count` hypotheses in `recovered`, without their lies."""
    recovered = found.recovered.m
    for j in range(SINGLE_FAULT_MODES):
        copy_column(recovered, j, found.single.m, j)
    for j in range(SINGLE_FAULT_MODES, count):
        copy_column(recovered, j, found.double.m, j - SINGLE_FAULT_MODES)
    for j in range(count):
        clear_offset(recovered, j)


@njit(cache=True, error_model="numpy")
def mix(row: Any, fault: float, over: float, p: ModeParams, found: Any) -> None:
    """Mix the faulty modes along the Markov chain: columns and `predicted_probability` become those before the reading.

    `fault` and `over` are the probabilities that a good sensor goes bad and a bad one good. The row still holds what
    was thought after the last reading, and so does `recovered`, without the lies.
    """
    single, double, recovered, mode_probability, predicted_probability = (
        found.single.m,
        found.double.m,
        found.recovered.m,
        row.mode_probability,
        found.predicted_probability,
    )
    second, alone, last = (1.0 - over) * fault, over * (1.0 - over), (1.0 - over) ** 2
    weight = moment_match_weighted(
        double, BOTH_NOISE_COLUMN, mode_probability[BOTH] * last, single, HEALTHY, mode_probability[HEALTHY] * fault**2
    )
    for noise in (NOISE, NOISE_V):
        weight = moment_match_weighted(
            double, BOTH_NOISE_COLUMN, weight, single, noise, 0.5 * mode_probability[noise] * second
        )
    predicted_probability[BOTH] = weight
    for sensor in (Z_POSITION, Z_SPEED):
        own = OTHER_SENSOR * sensor
        bias, drift, other_noise = BIAS + own, DRIFT + own, NOISE_V - own
        weight = moment_match_weighted(
            double, sensor, mode_probability[PAIR + sensor] * last, single, bias, mode_probability[bias] * second
        )
        weight = moment_match_weighted(double, sensor, weight, single, drift, mode_probability[drift] * second)
        copy_column(single, SPARE_COLUMN, single, other_noise)
        single[BB, SPARE_COLUMN], single[SS, SPARE_COLUMN] = 2.0 * p.fault_size**2, p.drift_slope0**2
        predicted_probability[PAIR + sensor] = moment_match_weighted(
            double, sensor, weight, single, SPARE_COLUMN, 0.5 * mode_probability[other_noise] * second
        )
    for sensor in (Z_POSITION, Z_SPEED):
        drift, noise, other_pair = DRIFT + OTHER_SENSOR * sensor, NOISE + OTHER_SENSOR * sensor, PAIR + 1 - sensor
        predicted_probability[drift] = moment_match_weighted(
            single, drift, predicted_probability[drift], row.double, sensor, mode_probability[PAIR + sensor] * alone
        )
        weight = moment_match_weighted(
            single, noise, predicted_probability[noise], recovered, other_pair, mode_probability[other_pair] * alone
        )
        predicted_probability[noise] = moment_match_weighted(
            single, noise, weight, recovered, BOTH, mode_probability[BOTH] * alone
        )


@njit(cache=True, error_model="numpy")
def add_acceleration_change(row: Any, change_mps2: float) -> None:
    """Change the acceleration in every hypothesis by what is known to come."""
    for j in range(SINGLE_COLUMNS):
        row.single[AX, j] += change_mps2
    if row.mode_probability[HEALTHY] <= PRUNE_DOUBLES_ABOVE:
        for j in range(DOUBLE_COLUMNS):
            row.double[AX, j] += change_mps2


@njit(cache=True, error_model="numpy")
def branch_to_faults(found: Any, dt_s: float, q: float, unexplained: float, p: ModeParams) -> None:
    """Fill the fresh lanes from the predicted HEALTHY: what may have begun since the last reading."""
    m, single = found.onset.m, found.single.m
    for i in range(SIZE):
        healthy = single[i, HEALTHY]
        for j in range(SINGLE_COLUMNS):
            m[i, j] = healthy
    add_jerk_noise(m, HEALTHY, dt_s, q * (p.manoeuvre_jerk - 1.0) + unexplained * p.manoeuvre_jerk_min)
    slow = exp(-0.5 * (m[VX, HEALTHY] / p.standstill_mps) ** 2)
    add_speed_jump(m, HEALTHY, dt_s, p.standstill_jump_mps**2 * slow)
    for sensor in (Z_POSITION, Z_SPEED):
        drift = DRIFT + OTHER_SENSOR * sensor
        m[BB, drift] = p.drift_offset0**2
        m[SS, drift] = p.drift_slope0**2 + p.drift_slope_share * (found.nu[sensor] / dt_s) ** 2


@njit(cache=True, error_model="numpy")
def update_single_faults(found: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Let the hypotheses of at most one lie take the reading, those that go on and those that begin."""
    single, onset, fault_size = found.single, found.onset, p.fault_size
    reset_likelihood(single)
    reset_likelihood(onset)
    x, v = z[Z_POSITION], z[Z_SPEED]
    update_scalar(single, Z_SPEED, v, r[Z_SPEED], fault_size, NOISE_V, NO_COLUMN, BIAS_V, DRIFT_V)
    update_scalar(onset, Z_SPEED, v, r[Z_SPEED], fault_size, BIAS_V, NOISE_V, DRIFT_V, NO_COLUMN)
    update_scalar(single, Z_POSITION, x, r[Z_POSITION], fault_size, NOISE, NO_COLUMN, BIAS, DRIFT)
    update_scalar(onset, Z_POSITION, x, r[Z_POSITION], fault_size, BIAS, NOISE, DRIFT, NO_COLUMN)
    set_offset(onset.m, BIAS, Z_POSITION, x, r[Z_POSITION])
    set_offset(onset.m, BIAS_V, Z_SPEED, v, r[Z_SPEED])


@njit(cache=True, error_model="numpy")
def update_double_faults(found: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Let the hypotheses of two lies take the reading."""
    double = found.double
    reset_likelihood(double)
    update_scalar(
        double,
        Z_SPEED,
        z[Z_SPEED],
        r[Z_SPEED],
        p.fault_size,
        POSITION_OFFSET_COLUMN,
        BOTH_NOISE_COLUMN,
        SPEED_OFFSET_COLUMN,
        NO_COLUMN,
    )
    update_scalar(
        double,
        Z_POSITION,
        z[Z_POSITION],
        r[Z_POSITION],
        p.fault_size,
        SPEED_OFFSET_COLUMN,
        BOTH_NOISE_COLUMN,
        POSITION_OFFSET_COLUMN,
        NO_COLUMN,
    )
    for j in range(DOUBLE_COLUMNS):
        found.predicted_probability[SINGLE_FAULT_MODES + j] *= likelihood(double, j)


@njit(cache=True, error_model="numpy")
def moment_match_onsets(found: Any) -> None:
    """Fold what begins into what goes on, by its `onset_share`."""
    single, onset, share = found.single.m, found.onset.m, found.onset_share
    for j in range(SINGLE_COLUMNS):
        moment_match(single, j, onset, j, share[j])


@njit(cache=True, error_model="numpy")
def branch_to_healthy(row: Any, over: float, count: int, z: Any, r: Any, found: Any) -> None:
    """Weigh for the first `count` hypotheses that each was true until now and is over; HEALTHY takes over."""
    recovered, ended_probability = found.recovered, found.ended_probability
    reset_likelihood(recovered)
    for sensor in (Z_SPEED, Z_POSITION):
        update_scalar(recovered, sensor, z[sensor], r[sensor], 0.0, NO_COLUMN, NO_COLUMN, NO_COLUMN, NO_COLUMN)
    weight = found.predicted_probability[HEALTHY]
    for j in range(1, count):
        ended_probability[j] = (
            row.mode_probability[j] * (over if j < SINGLE_FAULT_MODES else over**2) * likelihood(recovered, j)
        )
        weight = moment_match_weighted(found.single.m, HEALTHY, weight, recovered.m, j, ended_probability[j])
    found.predicted_probability[HEALTHY] = weight


@njit(cache=True, error_model="numpy")
def update(
    row: Any,
    dt_s: float,
    z: Any,
    r: Any,
    q: float,
    random_walk_density: float,
    unexplained: float,
    implausible: int,
    p: ModeParams,
    found: Any,
) -> bool:
    """Take one reading: a row (HYPOTHESES) becomes what is thought after it; `found` (FINDING) says the rest.

    Return whether a covariance had to be mended.

    Parameters
    ----------
    z, r
        (2,) reading of location and speed, and its variances.
    q, walk
        Density of the calm jerk, m^2/s^5, and of what location and speed differ by, m^2/s.
    unforeseen
        Share of the driver's manoeuvres that the car ahead does not announce.
    implausible
        `Sensor` whose reading breaks a physical limit: it is at fault whatever the motion says.
    """
    m, mode_probability, predicted_probability, nu, cov = (
        found.single.m,
        row.mode_probability,
        found.predicted_probability,
        found.nu,
        found.S,
    )
    fault = min(0.1, p.faults_per_s * dt_s)
    over = 1.0 - exp(-dt_s / p.fault_s)
    doubles_pruned = mode_probability[HEALTHY] > PRUNE_DOUBLES_ABOVE
    load(row, found, doubles_pruned)
    predicted_probability[HEALTHY] = mode_probability[HEALTHY] * (1.0 - 2.0 * fault)
    for j in range(1, SINGLE_FAULT_MODES):
        predicted_probability[j] = mode_probability[j] * (1.0 - over) * (1.0 - fault)
    predicted_probability[SINGLE_FAULT_MODES:] = 0.0
    if not doubles_pruned:
        save_prior(found, MODE_COUNT)
        mix(row, fault, over, p, found)
        predict(found.recovered, dt_s, q, random_walk_density)
        predict(found.double, dt_s, q, random_walk_density)
        for pair in (POSITION_OFFSET_COLUMN, SPEED_OFFSET_COLUMN):
            found.double.m[BB, pair] += p.offset_noise**2
    predict(found.single, dt_s, q, random_walk_density)
    nu[Z_POSITION], nu[Z_SPEED] = z[Z_POSITION] - m[PX, HEALTHY], z[Z_SPEED] - m[VX, HEALTHY]
    cov[0], cov[1], cov[2] = m[XX, HEALTHY] + r[Z_POSITION], m[XV, HEALTHY], m[VV, HEALTHY] + r[Z_SPEED]
    found.nis = nis_2d(nu[Z_POSITION], nu[Z_SPEED], cov[0], cov[1], cov[2], r[Z_SPEED])
    recovery_pruned = doubles_pruned and found.nis < PRUNE_RECOVERY_BELOW_NIS
    if doubles_pruned and not recovery_pruned:
        save_prior(found, SINGLE_FAULT_MODES)
    branch_to_faults(found, dt_s, q, unexplained, p)
    for j in (BIAS, DRIFT, BIAS_V, DRIFT_V):
        m[BB, j] += p.offset_noise**2
    update_single_faults(found, z, r, p)

    onset_probability = mode_probability[HEALTHY] * fault / 3.0
    manoeuvre = unexplained * p.manoeuvre
    manoeuvring = predicted_probability[HEALTHY] * manoeuvre
    predicted_probability[HEALTHY] *= 1.0 - manoeuvre
    for j in range(SINGLE_FAULT_MODES):
        arriving = (manoeuvring if j == HEALTHY else onset_probability) * likelihood(found.onset, j)
        predicted_probability[j] = predicted_probability[j] * likelihood(found.single, j) + arriving + 1e-280
        found.onset_share[j] = arriving / predicted_probability[j]
    moment_match_onsets(found)
    found.ended_probability[:] = 0.0
    if not recovery_pruned:
        branch_to_healthy(row, over, SINGLE_FAULT_MODES if doubles_pruned else MODE_COUNT, z, r, found)
    if not doubles_pruned:
        update_double_faults(found, z, r, p)
    if implausible & _POSITION_FAULT:
        predicted_probability[HEALTHY] *= IMPLAUSIBLE_LIKELIHOOD
        predicted_probability[BIAS_V:SINGLE_FAULT_MODES] *= IMPLAUSIBLE_LIKELIHOOD
        found.ended_probability[:] = 0.0
    if implausible & _SPEED_FAULT:
        predicted_probability[: NOISE + 1] *= IMPLAUSIBLE_LIKELIHOOD
        found.ended_probability[:] = 0.0
    elif z[Z_SPEED] < -5.0 * r[Z_SPEED] ** 0.5:
        # A speed is a magnitude: below zero beyond all noise, its sensor lies whatever the motion says.
        predicted_probability[: NOISE + 1] *= IMPLAUSIBLE_LIKELIHOOD
    total = predicted_probability.sum()
    for j in range(MODE_COUNT):
        mode_probability[j] = max(predicted_probability[j] / total, MODE_PROBABILITY_FLOOR)
        found.ended_probability[j] /= total
    repaired = repair_covariance(found.single)
    if not doubles_pruned:
        repaired |= repair_covariance(found.double)
    store(row, found, doubles_pruned)
    return repaired


@njit(cache=True, error_model="numpy")
def reset_to_measurement(row: Any, location: bool, speed: bool, mean: Any, z: Any, r: Any, p: ModeParams) -> None:
    """Believe `location`, `speed` or both from their present reading on, and keep the rest of the estimate `mean`.

    A sensor whose neighbour is not believed yet stays suspected.
    """
    mode_probability = row.mode_probability
    position_fault, speed_fault = sensor_fault_probability(mode_probability)
    if location:
        mean[PX], mean[XX], mean[XV], mean[XA] = z[Z_POSITION], r[Z_POSITION], 0.0, 0.0
    if speed:
        mean[VX], mean[VV], mean[XV], mean[VA] = z[Z_SPEED], r[Z_SPEED], 0.0, 0.0
        mean[AX], mean[XA], mean[AA] = 0.0, 0.0, p.a_std_mps2**2
    for j in range(SINGLE_COLUMNS):
        row.single[:, j] = mean
    for j in range(DOUBLE_COLUMNS):
        row.double[:, j] = mean
    mode_probability[:] = MODE_PROBABILITY_FLOOR
    if speed_fault > 0.5 and not speed:
        mode_probability[NOISE + OTHER_SENSOR] = 1.0
    elif position_fault > 0.5 and not location:
        mode_probability[NOISE] = 1.0
    else:
        mode_probability[HEALTHY] = 1.0


@njit(cache=True, error_model="numpy")
def sensor_fault_probability(mode_probability: Any) -> tuple[float, float]:
    """Return the probabilities that the location and that the speed lie."""
    double = mode_probability[SINGLE_FAULT_MODES:].sum()
    own, other = mode_probability[BIAS:BIAS_V].sum(), mode_probability[BIAS_V:SINGLE_FAULT_MODES].sum()
    return own + double, other + double
