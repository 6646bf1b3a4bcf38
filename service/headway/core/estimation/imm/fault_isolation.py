"""Which sensor lies, and how: read off the weights of `modes`, given that something lies at all."""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import BIAS, BOTH, DRIFT, NOISE, OTHER_PAIR, OTHER_SENSOR, PAIR
from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED
from headway.core.types.records import Kind, Sensor

X_LIES, V_LIES, BOTH_LIE = int(Sensor.LOCATION), int(Sensor.SPEED), int(Sensor.BOTH)
IS_SHORT, IS_NOISE, IS_BIAS, IS_DRIFT = int(Kind.SHORT), int(Kind.NOISE), int(Kind.BIAS), int(Kind.DRIFT)


@njit(cache=True, error_model="numpy")
def faulty_sensor(mode_probability: Any) -> int:
    """Return the `Sensor` code of the likeliest set of lying sensors."""
    x = mode_probability[BIAS] + mode_probability[DRIFT] + mode_probability[NOISE]
    v = (
        mode_probability[OTHER_SENSOR + BIAS]
        + mode_probability[OTHER_SENSOR + DRIFT]
        + mode_probability[OTHER_SENSOR + NOISE]
    )
    two = mode_probability[PAIR] + mode_probability[PAIR + OTHER_PAIR] + mode_probability[BOTH]
    if two > x and two > v:
        return BOTH_LIE
    return X_LIES if x > v else V_LIES


@njit(cache=True, error_model="numpy")
def fault_kind(mode_probability: Any, sensor: int) -> tuple[int, float]:
    """Return the likeliest `Kind` code of the lie of `sensor` (0, 1), and its probability, given that it lies."""
    own = OTHER_SENSOR * sensor
    noise = mode_probability[NOISE + own] + mode_probability[PAIR + 1 - sensor] + mode_probability[BOTH]
    line = mode_probability[BIAS + own] + mode_probability[DRIFT + own]
    # PAIR does not tell bias from drift: it is shared out as the two that it came from.
    share = 1.0 + mode_probability[PAIR + sensor] / line
    bias, drift = share * mode_probability[BIAS + own], share * mode_probability[DRIFT + own]
    total = noise + bias + drift
    if noise > bias and noise > drift:
        return IS_NOISE, noise / total
    if bias > drift:
        return IS_BIAS, bias / total
    return IS_DRIFT, drift / total


@njit(cache=True, error_model="numpy")
def isolate(mode_probability: Any, run_length: Any, over: float) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind, for an anomalous reading, and count it in `run_length` (2,).

    `run_length` counts the anomalous readings of each sensor so far. The first one is named short, with the probability
    `over` that the fault has ended by the next.
    """
    sensor = faulty_sensor(mode_probability)
    kind, confidence = 0, -1.0
    for which in (Z_POSITION, Z_SPEED):
        if sensor not in (which + 1, BOTH_LIE):
            run_length[which] = 0
            continue
        run_length[which] += 1
        here, certainty = fault_kind(mode_probability, which)
        if run_length[which] == 1:
            here, certainty = IS_SHORT, over
        if certainty > confidence:
            kind, confidence = here, certainty
    return sensor, kind, confidence


@njit(cache=True, error_model="numpy")
def isolate_ended(mode_probability: Any) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind of a lie that is told of only as it ends."""
    sensor = faulty_sensor(mode_probability)
    kind, confidence = 0, -1.0
    for which in (Z_POSITION, Z_SPEED):
        if sensor in (which + 1, BOTH_LIE):
            here, certainty = fault_kind(mode_probability, which)
            if certainty > confidence:
                kind, confidence = here, certainty
    return sensor, kind, confidence
