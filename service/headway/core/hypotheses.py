"""Ten hypotheses about one vehicle's two sensors, weighed against each other reading by reading.

An interacting-multiple-model filter (Blom, Bar-Shalom 1988, doi:10.1109/9.1299): every hypothesis is a filter of its
own (`motion`), a Markov chain moves weight between them, and what arrives at a hypothesis is merged into one Gaussian.
Nobody lies in HEALTHY. For each sensor (location: 1 to 4, speed: 5 to 8) four say how it lies,

    BIAS    by a constant offset               the other sensor is used; the offset is part of the state, so that
    DRIFT   by an offset that grows steadily   the differences of the lying readings still count
    NOISE   by anything, each time anew        the other sensor is used, this one not at all
    PAIR    by an offset, while the other sensor lies by anything

and in BOTH either lies by anything. HEALTHY is followed calm or manoeuvring (more jerk; near standstill a jump of the
speed as well, for speed sensors read zero below some speed), merged after each reading.
A sensor goes bad with `faults_per_s` and is bad for `fault_s` on average, each sensor for itself.
"""

from math import exp
from typing import Any, NamedTuple

from numba import njit

from headway.core.motion import (
    AA,
    BB,
    LOCATION,
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
    begin,
    blend,
    copy,
    copy_honest,
    disregard,
    jolt,
    jump,
    mend,
    merge,
    observe,
    predict,
)

HEALTHY, BOTH, COUNT = 0, 9, 10
BIAS, DRIFT, NOISE, PAIR = 1, 2, 3, 4
OTHER_SENSOR = 4
"""Added to one of the four above it means the speed sensor instead of the location."""
WEIGHT_FLOOR = 1e-10
"""No hypothesis ever dies, and the log odds stay within +-23."""
SCRATCH = 6
IMPOSSIBLE = 1e-8


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
    """Usual offset at the start of a drift, and its growth per second."""
    offset_walk: float
    """How far an offset strays from its straight line, per reading."""
    a_std_mps2: float
    """How well the acceleration of a vehicle not heard before is known."""


@njit(cache=True)
def begin_all(M: Any, w: Any, x_m: float, v_mps: float, r_x: float, r_v: float, p: Hypotheses) -> None:
    """Start every hypothesis of M (COUNT, SIZE) at a reading, and believe it."""
    for j in range(COUNT):
        begin(M[j], x_m, v_mps, r_x, r_v, p.a_std_mps2**2)
        w[j] = WEIGHT_FLOOR
    w[HEALTHY] = 1.0


@njit(cache=True)
def mix(M: Any, w: Any, fault: float, over: float, p: Hypotheses, prior: Any, scratch: Any) -> None:
    """Move weight along the Markov chain: M and `prior` (COUNT,) become what is thought before the next reading.

    `fault` and `over` are the probabilities that a good sensor goes bad and a bad one good. The way from HEALTHY to a
    single fault is left to `judge`, where the reading itself sets the offset.
    """
    healthy, both, spare, pair_x, pair_v = scratch[0], scratch[1], scratch[2], scratch[3], scratch[4]
    stay, second, alone = (1.0 - over) * (1.0 - fault), (1.0 - over) * fault, over * (1.0 - over)

    share = prior
    for j in range(COUNT):
        share[j] = w[j] * (over**2 if j in (BOTH, PAIR, PAIR + OTHER_SENSOR) else over)
    share[HEALTHY] = w[HEALTHY] * (1.0 - 2.0 * fault)
    into_healthy = blend(M, share, healthy)
    share[:] = 0.0
    share[HEALTHY] = w[HEALTHY] * fault**2
    share[NOISE] = 0.5 * w[NOISE] * second
    share[NOISE + OTHER_SENSOR] = 0.5 * w[NOISE + OTHER_SENSOR] * second
    share[BOTH] = w[BOTH] * (1.0 - over) ** 2
    into_both = blend(M, share, both)
    prior[HEALTHY], prior[BOTH] = into_healthy, into_both

    copy(pair_x, M[PAIR])
    copy(pair_v, M[PAIR + OTHER_SENSOR])
    for sensor in (LOCATION, SPEED):
        own, other = OTHER_SENSOR * sensor, OTHER_SENSOR * (1 - sensor)
        pair, weight = M[PAIR + own], w[PAIR + own] * (1.0 - over) ** 2
        weight = merge(pair, weight, M[BIAS + own], w[BIAS + own] * second)
        weight = merge(pair, weight, M[DRIFT + own], w[DRIFT + own] * second)
        copy(spare, M[NOISE + other])
        spare[BB], spare[SS] = 2.0 * p.spread**2, p.drift_slope**2
        prior[PAIR + own] = merge(pair, weight, spare, 0.5 * w[NOISE + other] * second)
    for sensor in (LOCATION, SPEED):
        own, other = OTHER_SENSOR * sensor, OTHER_SENSOR * (1 - sensor)
        prior[BIAS + own] = w[BIAS + own] * stay
        own_pair, other_pair = (pair_x, pair_v) if sensor == LOCATION else (pair_v, pair_x)
        prior[DRIFT + own] = merge(M[DRIFT + own], w[DRIFT + own] * stay, own_pair, w[PAIR + own] * alone)
        copy_honest(spare, other_pair)
        weight = merge(M[NOISE + own], w[NOISE + own] * stay, spare, w[PAIR + other] * alone)
        prior[NOISE + own] = merge(M[NOISE + own], weight, M[BOTH], w[BOTH] * alone)

    copy(M[HEALTHY], healthy)
    copy(M[BOTH], both)


@njit(cache=True)
def judge_sensor(
    M: Any, prior: Any, suspected: float, sensor: int, z: Any, r: Any, p: Hypotheses, w: Any, scratch: Any
) -> None:
    """Weigh the four ways in which one `sensor` lies; `suspected` is the weight that comes from HEALTHY.

    M holds predictions; M[HEALTHY] is left as it is. Writes unnormalised weights into `w`.
    """
    without, spare = scratch[0], scratch[1]
    other, own = 1 - sensor, OTHER_SENSOR * sensor
    walk = p.offset_walk**2

    copy(without, M[HEALTHY])
    likelihood = observe(without, other, False, z[other], r[other])
    strange = likelihood * disregard(without, sensor, z[sensor], r[sensor], p.spread)

    m = M[BIAS + own]
    m[BB] += walk
    w[BIAS + own] = prior[BIAS + own] * observe(m, other, False, z[other], r[other])
    w[BIAS + own] *= observe(m, sensor, True, z[sensor], r[sensor])
    copy(spare, without)
    accuse(spare, sensor, z[sensor], r[sensor])
    w[BIAS + own] = merge(m, w[BIAS + own], spare, suspected * strange)

    m = M[DRIFT + own]
    m[BB] += walk
    w[DRIFT + own] = prior[DRIFT + own] * observe(m, other, False, z[other], r[other])
    w[DRIFT + own] *= observe(m, sensor, True, z[sensor], r[sensor])
    copy(spare, without)
    spare[BB], spare[SS] = p.drift_start**2, p.drift_slope**2
    begun = likelihood * observe(spare, sensor, True, z[sensor], r[sensor])
    w[DRIFT + own] = merge(m, w[DRIFT + own], spare, suspected * begun)

    m = M[NOISE + own]
    w[NOISE + own] = prior[NOISE + own] * observe(m, other, False, z[other], r[other])
    w[NOISE + own] *= disregard(m, sensor, z[sensor], r[sensor], p.spread)
    w[NOISE + own] = merge(m, w[NOISE + own], without, suspected * strange)

    m = M[PAIR + own]
    m[BB] += walk
    w[PAIR + own] = prior[PAIR + own] * disregard(m, other, z[other], r[other], p.spread)
    w[PAIR + own] *= observe(m, sensor, True, z[sensor], r[sensor])


@njit(cache=True)
def judge(
    M: Any,
    w: Any,
    dt_s: float,
    z: Any,
    r: Any,
    q: float,
    walk: float,
    p: Hypotheses,
    prior: Any,
    scratch: Any,
    out: Any,
) -> bool:
    """Take one reading: M (COUNT, SIZE) and w (COUNT,) become what is thought after it.

    Return whether a covariance had to be mended.

    Parameters
    ----------
    z, r
        (2,) reading of location and speed, and its variances.
    q, walk
        Density of the calm jerk, m^2/s^5, and of what location and speed differ by, m^2/s.
    prior, scratch
        (COUNT,) and (SCRATCH, SIZE), room to work in.
    out
        (5,): innovation of location and speed under HEALTHY, and its covariance xx, xv, vv.
    """
    fault = min(0.1, p.faults_per_s * dt_s)
    over = 1.0 - exp(-dt_s / p.fault_s)
    suspected = w[HEALTHY] * fault / 3.0
    mix(M, w, fault, over, p, prior, scratch)
    for j in range(COUNT):
        predict(M[j], dt_s, q, walk)
    m, spare = M[HEALTHY], scratch[2]
    out[0], out[1] = z[LOCATION] - m[X], z[SPEED] - m[V]
    out[2], out[3], out[4] = m[XX] + r[LOCATION], m[XV], m[VV] + r[SPEED]

    judge_sensor(M, prior, suspected, LOCATION, z, r, p, w, scratch)
    judge_sensor(M, prior, suspected, SPEED, z, r, p, w, scratch)
    w[BOTH] = prior[BOTH] * disregard(M[BOTH], LOCATION, z[LOCATION], r[LOCATION], p.spread)
    w[BOTH] *= disregard(M[BOTH], SPEED, z[SPEED], r[SPEED], p.spread)

    copy(spare, m)
    jolt(spare, dt_s, q * (p.manoeuvre_jerk - 1.0) + p.manoeuvre_least)
    jump(spare, dt_s, p.standstill_jump_mps**2 * exp(-0.5 * (m[V] / p.standstill_mps) ** 2))
    calm = prior[HEALTHY] * (1.0 - p.manoeuvre)
    lively = prior[HEALTHY] * p.manoeuvre
    for sensor in (SPEED, LOCATION):
        calm *= observe(m, sensor, False, z[sensor], r[sensor])
        lively *= observe(spare, sensor, False, z[sensor], r[sensor])
    w[HEALTHY] = merge(m, calm + 1e-280, spare, lively)
    if z[SPEED] < -5.0 * r[SPEED] ** 0.5:
        # A speed is a magnitude: below zero beyond all noise, its sensor lies whatever the motion says.
        w[HEALTHY] *= IMPOSSIBLE
        for j in (BIAS, DRIFT, NOISE):
            w[j] *= IMPOSSIBLE
    total, mended = w.sum(), False
    for j in range(COUNT):
        w[j] = max(w[j] / total, WEIGHT_FLOOR)
        mended |= mend(M[j])
    return mended


@njit(cache=True)
def give_in(M: Any, w: Any, location: bool, speed: bool, z: Any, r: Any, p: Hypotheses, scratch: Any) -> None:
    """Believe `location`, `speed` or both from their present reading on, and keep what is known of the rest.

    A sensor whose neighbour is not believed yet stays suspected.
    """
    wrong_x, wrong_v = suspicion(w)
    honest = scratch[0]
    blend(M, w, honest)
    if location:
        honest[X], honest[XX], honest[XV], honest[XA] = z[LOCATION], r[LOCATION], 0.0, 0.0
    if speed:
        honest[V], honest[VV], honest[XV], honest[VA] = z[SPEED], r[SPEED], 0.0, 0.0
        honest[A], honest[XA], honest[AA] = 0.0, 0.0, p.a_std_mps2**2
    for j in range(COUNT):
        copy(M[j], honest)
        w[j] = WEIGHT_FLOOR
    if wrong_v > 0.5 and not speed:
        w[NOISE + OTHER_SENSOR] = 1.0
    elif wrong_x > 0.5 and not location:
        w[NOISE] = 1.0
    else:
        w[HEALTHY] = 1.0


@njit(cache=True)
def suspicion(w: Any) -> tuple[float, float]:
    """Return the probabilities that the location and that the speed lie."""
    two = w[PAIR] + w[PAIR + OTHER_SENSOR] + w[BOTH]
    return (
        w[BIAS] + w[DRIFT] + w[NOISE] + two,
        w[BIAS + OTHER_SENSOR] + w[DRIFT + OTHER_SENSOR] + w[NOISE + OTHER_SENSOR] + two,
    )
