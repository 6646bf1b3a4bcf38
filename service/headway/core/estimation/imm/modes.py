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
    BB,
    LOCATION,
    NO_LANE,
    SIZE,
    SPEED,
    SS,
    VA,
    VV,
    XA,
    XV,
    XX,
    A,
    V,
    X,
    accuse,
    acquit,
    begin,
    copy,
    fold,
    jolt,
    jump,
    lanes,
    likelihood,
    mend,
    merge,
    predict,
    read,
    unread,
)

HEALTHY, BIAS, DRIFT, NOISE = 0, 1, 2, 3
OTHER_SENSOR = 3
"""Added to one of the last three it means the speed sensor instead of the location."""
PAIR, BOTH = 7, 9
OTHER_PAIR = 1
SINGLE, COUNT = 7, 10
"""Hypotheses below SINGLE are those of at most one lie."""
WEIGHT_FLOOR = 1e-10
"""No hypothesis ever dies, and the log odds stay within +-23."""
IMPOSSIBLE = 1e-8
CALM = 0.9997
"""Probability of HEALTHY beyond which nobody thinks of two lies at once,"""
CALM_NIS = 9.0
"""nor, if its nis is below this, of a lie that has just ended."""

LANES = SINGLE + 1
PAIRS = COUNT - SINGLE
HYPOTHESES = np.dtype([("one", "f8", (SIZE, LANES)), ("two", "f8", (SIZE, PAIRS)), ("w", "f8", (COUNT,))], align=True)
"""What is kept of a vehicle between two readings: a weight for each hypothesis, and a lane.

`one` are those of at most one lie, its last lane being spare; `two` those of two, kept up only while HEALTHY is no more
likely than CALM.
"""
SPARE = SINGLE

BIAS_V, DRIFT_V, NOISE_V = BIAS + OTHER_SENSOR, DRIFT + OTHER_SENSOR, NOISE + OTHER_SENSOR
LOCATION_PAIR, SPEED_PAIR, BOTH_PAIR = range(PAIRS)
"""Lanes of `two`."""

FINDING = np.dtype(
    [
        ("one", lanes(LANES)),
        ("fresh", lanes(LANES)),  # what comes to each hypothesis from HEALTHY now: a lie begins, or a manoeuvre
        ("past", lanes(COUNT)),  # each hypothesis as if its lie were over
        ("two", lanes(PAIRS)),
        ("prior", "f8", (COUNT,)),
        ("share", "f8", (LANES,)),  # of the fresh lanes in what comes of both
        ("ended", "f8", (COUNT,)),  # weight of: this hypothesis was true until now, and is over
        ("nu", "f8", (2,)),  # innovation of location and speed under HEALTHY,
        ("S", "f8", (3,)),  # and its covariance xx, xv, vv
    ],
    align=True,
)
"""What `judge` works in, and answers with: `ended`, `nu`, `S`."""


class Hypotheses(NamedTuple):
    """What is thought possible before any reading; SI units."""

    faults_per_s: float
    fault_s: float
    manoeuvre: float
    """Probability that a reading belongs to a manoeuvre."""
    manoeuvre_jerk: float
    """Density of the jerk then, as a multiple of the calm one,"""
    manoeuvre_least: float
    """and on top of that, m^2/s^5: whoever drove steadily for long brakes as hard as others do."""
    standstill_mps: float
    """Below about this speed it may seem to jump,"""
    standstill_jump_mps: float
    """by about this much."""
    spread: float
    """Usual size of a fault, m or m/s; the tails are heavy."""
    drift_start: float
    drift_slope: float
    """Usual offset at the start of a drift, and its growth per second;"""
    drift_steep: float
    """of the slope that the first innovation would mean, this share (of the variance) is thought possible as well."""
    offset_walk: float
    """How far an offset strays from its straight line, per reading."""
    a_std_mps2: float
    """How well the acceleration of a vehicle not heard before is known."""


@njit(cache=True)
def begin_all(row: Any, x_m: float, v_mps: float, r: Any, p: Hypotheses) -> None:
    """Start every hypothesis of a row (HYPOTHESES) at a reading of variances `r` (2,), and believe it."""
    for j in range(LANES):
        begin(row.one, j, x_m, v_mps, r[LOCATION], r[SPEED], p.a_std_mps2**2)
    row.w[:] = WEIGHT_FLOOR
    row.w[HEALTHY] = 1.0


@njit(cache=True)
def add_means(m: Any, w: Any, first: int, last: int, into: Any) -> None:
    """Add up the means of hypotheses `first` to `last`, which are lanes 0, 1, ... of m."""
    for j in range(first, last):
        for i in (X, V, A):
            into[i] += w[j] * m[i, j - first]


@njit(cache=True)
def add_spreads(m: Any, w: Any, first: int, last: int, into: Any) -> None:
    """Add up the covariances of the same, about the mean that is in `into` by now."""
    for j in range(first, last):
        k = j - first
        dx, dv, da = m[X, k] - into[X], m[V, k] - into[V], m[A, k] - into[A]
        into[XX] += w[j] * (m[XX, k] + dx * dx)
        into[XV] += w[j] * (m[XV, k] + dx * dv)
        into[XA] += w[j] * (m[XA, k] + dx * da)
        into[VV] += w[j] * (m[VV, k] + dv * dv)
        into[VA] += w[j] * (m[VA, k] + dv * da)
        into[AA] += w[j] * (m[AA, k] + da * da)


@njit(cache=True)
def estimate(row: Any, into: Any) -> None:
    """Write mean and covariance of the car's own motion, over all hypotheses and without any lie, to `into` (SIZE,)."""
    into[:] = 0.0
    calm = row.w[HEALTHY] > CALM
    add_means(row.one, row.w, 0, SINGLE, into)
    if not calm:
        add_means(row.two, row.w, SINGLE, COUNT, into)
    add_spreads(row.one, row.w, 0, SINGLE, into)
    if not calm:
        add_spreads(row.two, row.w, SINGLE, COUNT, into)


@njit(cache=True)
def take_out(row: Any, found: Any, calm: bool) -> None:
    """Copy lanes of the row to where they are worked on."""
    for i in range(SIZE):
        for j in range(LANES):
            found.one.m[i, j] = row.one[i, j]
    if not calm:
        found.two.m[:] = row.two


@njit(cache=True)
def put_back(row: Any, found: Any, was_calm: bool) -> None:
    """Copy them back; hypotheses of two lies that nobody thought of until now know what HEALTHY knows."""
    for i in range(SIZE):
        for j in range(LANES):
            row.one[i, j] = found.one.m[i, j]
    if row.w[HEALTHY] <= CALM:
        for j in range(PAIRS):
            if was_calm:
                copy(row.two, j, found.one.m, HEALTHY)
            else:
                copy(row.two, j, found.two.m, j)


@njit(cache=True)
def remember(found: Any, count: int) -> None:
    """Keep the first `count` hypotheses in `past`, without their lies."""
    past = found.past.m
    for j in range(SINGLE):
        copy(past, j, found.one.m, j)
    for j in range(SINGLE, count):
        copy(past, j, found.two.m, j - SINGLE)
    for j in range(count):
        acquit(past, j)


@njit(cache=True)
def mix(row: Any, fault: float, over: float, p: Hypotheses, found: Any) -> None:
    """Move weight between the lies along the Markov chain: lanes and `prior` become what is thought before the reading.

    `fault` and `over` are the probabilities that a good sensor goes bad and a bad one good. The row still holds what
    was thought after the last reading, and so does `past`, without the lies.
    """
    one, two, past, w, prior = found.one.m, found.two.m, found.past.m, row.w, found.prior
    second, alone, last = (1.0 - over) * fault, over * (1.0 - over), (1.0 - over) ** 2
    weight = merge(two, BOTH_PAIR, w[BOTH] * last, one, HEALTHY, w[HEALTHY] * fault**2)
    for noise in (NOISE, NOISE_V):
        weight = merge(two, BOTH_PAIR, weight, one, noise, 0.5 * w[noise] * second)
    prior[BOTH] = weight
    for sensor in (LOCATION, SPEED):
        own = OTHER_SENSOR * sensor
        bias, drift, other_noise = BIAS + own, DRIFT + own, NOISE_V - own
        weight = merge(two, sensor, w[PAIR + sensor] * last, one, bias, w[bias] * second)
        weight = merge(two, sensor, weight, one, drift, w[drift] * second)
        copy(one, SPARE, one, other_noise)
        one[BB, SPARE], one[SS, SPARE] = 2.0 * p.spread**2, p.drift_slope**2
        prior[PAIR + sensor] = merge(two, sensor, weight, one, SPARE, 0.5 * w[other_noise] * second)
    for sensor in (LOCATION, SPEED):
        drift, noise, other_pair = DRIFT + OTHER_SENSOR * sensor, NOISE + OTHER_SENSOR * sensor, PAIR + 1 - sensor
        prior[drift] = merge(one, drift, prior[drift], row.two, sensor, w[PAIR + sensor] * alone)
        weight = merge(one, noise, prior[noise], past, other_pair, w[other_pair] * alone)
        prior[noise] = merge(one, noise, weight, past, BOTH, w[BOTH] * alone)


@njit(cache=True)
def push(row: Any, change_mps2: float) -> None:
    """Change the acceleration in every hypothesis by what is known to come."""
    for j in range(LANES):
        row.one[A, j] += change_mps2
    if row.w[HEALTHY] <= CALM:
        for j in range(PAIRS):
            row.two[A, j] += change_mps2


@njit(cache=True)
def begin_lies(found: Any, dt_s: float, q: float, unforeseen: float, p: Hypotheses) -> None:
    """Fill the fresh lanes from the predicted HEALTHY: what may have begun since the last reading."""
    m, one = found.fresh.m, found.one.m
    for i in range(SIZE):
        healthy = one[i, HEALTHY]
        for j in range(LANES):
            m[i, j] = healthy
    jolt(m, HEALTHY, dt_s, q * (p.manoeuvre_jerk - 1.0) + unforeseen * p.manoeuvre_least)
    slow = exp(-0.5 * (m[V, HEALTHY] / p.standstill_mps) ** 2)
    jump(m, HEALTHY, dt_s, p.standstill_jump_mps**2 * slow)
    for sensor in (LOCATION, SPEED):
        drift = DRIFT + OTHER_SENSOR * sensor
        m[BB, drift] = p.drift_start**2
        m[SS, drift] = p.drift_slope**2 + p.drift_steep * (found.nu[sensor] / dt_s) ** 2


@njit(cache=True)
def read_singles(found: Any, z: Any, r: Any, p: Hypotheses) -> None:
    """Let the hypotheses of at most one lie take the reading, those that go on and those that begin."""
    one, fresh, spread = found.one, found.fresh, p.spread
    unread(one)
    unread(fresh)
    x, v = z[LOCATION], z[SPEED]
    read(one, SPEED, v, r[SPEED], spread, NOISE_V, NO_LANE, BIAS_V, DRIFT_V)
    read(fresh, SPEED, v, r[SPEED], spread, BIAS_V, NOISE_V, DRIFT_V, NO_LANE)
    read(one, LOCATION, x, r[LOCATION], spread, NOISE, NO_LANE, BIAS, DRIFT)
    read(fresh, LOCATION, x, r[LOCATION], spread, BIAS, NOISE, DRIFT, NO_LANE)
    accuse(fresh.m, BIAS, LOCATION, x, r[LOCATION])
    accuse(fresh.m, BIAS_V, SPEED, v, r[SPEED])


@njit(cache=True)
def read_pairs(found: Any, z: Any, r: Any, p: Hypotheses) -> None:
    """Let the hypotheses of two lies take the reading."""
    two = found.two
    unread(two)
    read(two, SPEED, z[SPEED], r[SPEED], p.spread, LOCATION_PAIR, BOTH_PAIR, SPEED_PAIR, NO_LANE)
    read(two, LOCATION, z[LOCATION], r[LOCATION], p.spread, SPEED_PAIR, BOTH_PAIR, LOCATION_PAIR, NO_LANE)
    for j in range(PAIRS):
        found.prior[SINGLE + j] *= likelihood(two, j)


@njit(cache=True)
def join(found: Any) -> None:
    """Fold what begins into what goes on, by its `share`."""
    one, fresh, share = found.one.m, found.fresh.m, found.share
    for j in range(LANES):
        fold(one, j, fresh, j, share[j])


@njit(cache=True)
def end_lies(row: Any, over: float, count: int, z: Any, r: Any, found: Any) -> None:
    """Weigh for the first `count` hypotheses that each was true until now and is over; HEALTHY takes over."""
    past, ended = found.past, found.ended
    unread(past)
    for sensor in (SPEED, LOCATION):
        read(past, sensor, z[sensor], r[sensor], 0.0, NO_LANE, NO_LANE, NO_LANE, NO_LANE)
    weight = found.prior[HEALTHY]
    for j in range(1, count):
        ended[j] = row.w[j] * (over if j < SINGLE else over**2) * likelihood(past, j)
        weight = merge(found.one.m, HEALTHY, weight, past.m, j, ended[j])
    found.prior[HEALTHY] = weight


@njit(cache=True)
def judge(
    row: Any, dt_s: float, z: Any, r: Any, q: float, walk: float, unforeseen: float, p: Hypotheses, found: Any
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
    """
    m, w, prior, nu, cov = found.one.m, row.w, found.prior, found.nu, found.S
    fault = min(0.1, p.faults_per_s * dt_s)
    over = 1.0 - exp(-dt_s / p.fault_s)
    calm = w[HEALTHY] > CALM
    take_out(row, found, calm)
    prior[HEALTHY] = w[HEALTHY] * (1.0 - 2.0 * fault)
    for j in range(1, SINGLE):
        prior[j] = w[j] * (1.0 - over) * (1.0 - fault)
    prior[SINGLE:] = 0.0
    if not calm:
        remember(found, COUNT)
        mix(row, fault, over, p, found)
        predict(found.past, dt_s, q, walk)
        predict(found.two, dt_s, q, walk)
        for pair in (LOCATION_PAIR, SPEED_PAIR):
            found.two.m[BB, pair] += p.offset_walk**2
    predict(found.one, dt_s, q, walk)
    nu[LOCATION], nu[SPEED] = z[LOCATION] - m[X, HEALTHY], z[SPEED] - m[V, HEALTHY]
    cov[0], cov[1], cov[2] = m[XX, HEALTHY] + r[LOCATION], m[XV, HEALTHY], m[VV, HEALTHY] + r[SPEED]
    nis = cov[2] * nu[LOCATION] ** 2 - 2.0 * cov[1] * nu[LOCATION] * nu[SPEED] + cov[0] * nu[SPEED] ** 2
    quiet = calm and nis < CALM_NIS * (cov[0] * cov[2] - cov[1] ** 2)
    if calm and not quiet:
        remember(found, SINGLE)
    begin_lies(found, dt_s, q, unforeseen, p)
    for j in (BIAS, DRIFT, BIAS_V, DRIFT_V):
        m[BB, j] += p.offset_walk**2
    read_singles(found, z, r, p)

    suspected = w[HEALTHY] * fault / 3.0
    manoeuvre = unforeseen * p.manoeuvre
    lively = prior[HEALTHY] * manoeuvre
    prior[HEALTHY] *= 1.0 - manoeuvre
    for j in range(SINGLE):
        came = (lively if j == HEALTHY else suspected) * likelihood(found.fresh, j)
        prior[j] = prior[j] * likelihood(found.one, j) + came + 1e-280
        found.share[j] = came / prior[j]
    join(found)
    found.ended[:] = 0.0
    if not quiet:
        end_lies(row, over, SINGLE if calm else COUNT, z, r, found)
    if not calm:
        read_pairs(found, z, r, p)
    if z[SPEED] < -5.0 * r[SPEED] ** 0.5:
        # A speed is a magnitude: below zero beyond all noise, its sensor lies whatever the motion says.
        prior[: NOISE + 1] *= IMPOSSIBLE
    total = prior.sum()
    for j in range(COUNT):
        w[j] = max(prior[j] / total, WEIGHT_FLOOR)
        found.ended[j] /= total
    mended = mend(found.one)
    if not calm:
        mended |= mend(found.two)
    put_back(row, found, calm)
    return mended


@njit(cache=True)
def give_in(row: Any, location: bool, speed: bool, mean: Any, z: Any, r: Any, p: Hypotheses) -> None:
    """Believe `location`, `speed` or both from their present reading on, and keep the rest of the estimate `mean`.

    A sensor whose neighbour is not believed yet stays suspected.
    """
    w = row.w
    wrong_x, wrong_v = suspicion(w)
    if location:
        mean[X], mean[XX], mean[XV], mean[XA] = z[LOCATION], r[LOCATION], 0.0, 0.0
    if speed:
        mean[V], mean[VV], mean[XV], mean[VA] = z[SPEED], r[SPEED], 0.0, 0.0
        mean[A], mean[XA], mean[AA] = 0.0, 0.0, p.a_std_mps2**2
    for j in range(LANES):
        row.one[:, j] = mean
    for j in range(PAIRS):
        row.two[:, j] = mean
    w[:] = WEIGHT_FLOOR
    if wrong_v > 0.5 and not speed:
        w[NOISE + OTHER_SENSOR] = 1.0
    elif wrong_x > 0.5 and not location:
        w[NOISE] = 1.0
    else:
        w[HEALTHY] = 1.0


@njit(cache=True)
def suspicion(w: Any) -> tuple[float, float]:
    """Return the probabilities that the location and that the speed lie."""
    two = w[SINGLE:].sum()
    own, other = w[BIAS:BIAS_V].sum(), w[BIAS_V:SINGLE].sum()
    return own + two, other + two
