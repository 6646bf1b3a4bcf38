"""Fault isolation (Isermann 2006, Fault-Diagnosis Systems): sensor and kind, read off the mode probabilities."""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import (
    BIAS,
    BOTH_NOISE,
    DRIFT,
    NOISE,
    NOISE_BESIDE_OFFSET,
    OFFSET_BESIDE_NOISE,
)
from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED
from headway.core.types.records import Kind, Sensor

SENSORS = (int(Sensor.LOCATION), int(Sensor.SPEED))
"""By index of z."""
BOTH = int(Sensor.BOTH)
KIND_SHORT, KIND_NOISE, KIND_BIAS, KIND_DRIFT = int(Kind.SHORT), int(Kind.NOISE), int(Kind.BIAS), int(Kind.DRIFT)


@njit(cache=True, error_model="numpy")
def faulty_sensor(mu: Any) -> int:
    """Return the `Sensor` code of the likeliest set of faulty sensors, given that there is a fault."""
    position = mu[BIAS[Z_POSITION]] + mu[DRIFT[Z_POSITION]] + mu[NOISE[Z_POSITION]]
    speed = mu[BIAS[Z_SPEED]] + mu[DRIFT[Z_SPEED]] + mu[NOISE[Z_SPEED]]
    two = mu[OFFSET_BESIDE_NOISE[Z_POSITION]] + mu[OFFSET_BESIDE_NOISE[Z_SPEED]] + mu[BOTH_NOISE]
    if two > position and two > speed:
        return BOTH
    return SENSORS[Z_POSITION] if position > speed else SENSORS[Z_SPEED]


@njit(cache=True, error_model="numpy")
def fault_kind(mu: Any, sensor: int) -> tuple[int, float]:
    """Return the likeliest `Kind` code of the fault of `sensor` (index of z), and its probability given a fault."""
    noise = mu[NOISE[sensor]] + mu[NOISE_BESIDE_OFFSET[sensor]] + mu[BOTH_NOISE]
    offset = mu[BIAS[sensor]] + mu[DRIFT[sensor]]
    # An offset beside noise is neither bias nor drift: it is divided in the ratio of the two.
    share = 1.0 + mu[OFFSET_BESIDE_NOISE[sensor]] / offset
    bias, drift = share * mu[BIAS[sensor]], share * mu[DRIFT[sensor]]
    total = noise + bias + drift
    if noise > bias and noise > drift:
        return KIND_NOISE, noise / total
    if bias > drift:
        return KIND_BIAS, bias / total
    return KIND_DRIFT, drift / total


@njit(cache=True, error_model="numpy")
def isolate(mu: Any, run_length: Any, end: float) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind for an anomalous reading, and count it in `run_length` (2,).

    `run_length` counts the anomalous readings of each sensor so far. The first one is named short, with the probability
    `end` that the fault has ended by the next.
    """
    sensor = faulty_sensor(mu)
    kind, confidence = 0, -1.0
    for z in (Z_POSITION, Z_SPEED):
        if sensor not in (SENSORS[z], BOTH):
            run_length[z] = 0
            continue
        run_length[z] += 1
        candidate, probability = fault_kind(mu, z)
        if run_length[z] == 1:
            candidate, probability = KIND_SHORT, end
        if probability > confidence:
            kind, confidence = candidate, probability
    return sensor, kind, confidence


@njit(cache=True, error_model="numpy")
def isolate_ended(mu: Any) -> tuple[int, int, float]:
    """Return sensor, kind and the confidence in the kind of a fault that is detected only as it ends."""
    sensor = faulty_sensor(mu)
    kind, confidence = 0, -1.0
    for z in (Z_POSITION, Z_SPEED):
        if sensor in (SENSORS[z], BOTH):
            candidate, probability = fault_kind(mu, z)
            if probability > confidence:
                kind, confidence = candidate, probability
    return sensor, kind, confidence
