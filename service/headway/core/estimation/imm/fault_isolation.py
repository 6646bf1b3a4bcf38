"""Which sensor lies, and how: read off the weights of `hypotheses`, given that something lies at all."""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import BIAS, BOTH, DRIFT, NOISE, OTHER_PAIR, OTHER_SENSOR, PAIR
from headway.core.estimation.kinematics import LOCATION, SPEED
from headway.core.types.records import Kind, Sensor

X_LIES, V_LIES, BOTH_LIE = int(Sensor.LOCATION), int(Sensor.SPEED), int(Sensor.BOTH)
IS_SHORT, IS_NOISE, IS_BIAS, IS_DRIFT = int(Kind.SHORT), int(Kind.NOISE), int(Kind.BIAS), int(Kind.DRIFT)


@njit(cache=True)
def lying_sensor(w: Any) -> int:
    """Return the `Sensor` code of the likeliest set of lying sensors."""
    x = w[BIAS] + w[DRIFT] + w[NOISE]
    v = w[OTHER_SENSOR + BIAS] + w[OTHER_SENSOR + DRIFT] + w[OTHER_SENSOR + NOISE]
    two = w[PAIR] + w[PAIR + OTHER_PAIR] + w[BOTH]
    if two > x and two > v:
        return BOTH_LIE
    return X_LIES if x > v else V_LIES


@njit(cache=True)
def lie_of(w: Any, sensor: int) -> tuple[int, float]:
    """Return the likeliest `Kind` code of the lie of `sensor` (0, 1), and its probability, given that it lies."""
    own = OTHER_SENSOR * sensor
    noise = w[NOISE + own] + w[PAIR + 1 - sensor] + w[BOTH]
    line = w[BIAS + own] + w[DRIFT + own]
    # PAIR does not tell bias from drift: it is shared out as the two that it came from.
    share = 1.0 + w[PAIR + sensor] / line
    bias, drift = share * w[BIAS + own], share * w[DRIFT + own]
    total = noise + bias + drift
    if noise > bias and noise > drift:
        return IS_NOISE, noise / total
    if bias > drift:
        return IS_BIAS, bias / total
    return IS_DRIFT, drift / total


@njit(cache=True)
def name_lie(w: Any, run: Any, over: float) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind, for an anomalous reading, and count it in `run` (2,).

    `run` holds for how many anomalous readings each sensor has lied so far. A first one is called short, with the
    probability `over` that it is not followed by more of the same.
    """
    sensor = lying_sensor(w)
    kind, confidence = 0, -1.0
    for which in (LOCATION, SPEED):
        if sensor not in (which + 1, BOTH_LIE):
            run[which] = 0
            continue
        run[which] += 1
        here, certainty = lie_of(w, which)
        if run[which] == 1:
            here, certainty = IS_SHORT, over
        if certainty > confidence:
            kind, confidence = here, certainty
    return sensor, kind, confidence


@njit(cache=True)
def name_past_lie(w: Any) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind of a lie that is told of only as it ends."""
    sensor = lying_sensor(w)
    kind, confidence = 0, -1.0
    for which in (LOCATION, SPEED):
        if sensor in (which + 1, BOTH_LIE):
            here, certainty = lie_of(w, which)
            if certainty > confidence:
                kind, confidence = here, certainty
    return sensor, kind, confidence
