"""No sensor is suspected for ever: after a while it is believed again, and what was learnt of it is doubted.

An offset of the location that does not end cannot be told from an estimate that has gone astray, and noise that does
not end is simply the sensor's. So a suspicion ends with the suspect's own reading taken for true. When that happens
again soon, or to a vehicle not known well yet, the levels in `noise_levels` were wrong, and are moved by a large step.
"""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import (
    BIAS,
    BOTH,
    DRIFT,
    NOISE,
    OTHER_SENSOR,
    PAIR,
    reset_to_measurement,
    sensor_fault_probability,
)
from headway.core.estimation.imm.noise_adaptation import add_speed_bias, clip
from headway.core.estimation.kinematics import SLOPE, Z_POSITION, Z_SPEED

NOISE_INFLATION = 16.0
"""Factor on the variance of a sensor whose noise does not end, or on the walk of a location whose offset does not."""
INFLATED_RANDOM_WALK_MIN = 1e-3
"""Least walk (m^2/s) after such a step: a location wanders by a centimetre a reading, or not at all."""
SPEED_BIAS_STEP_MAX_MPS = 1.0
"""Most that the slip changes at such a step."""
REPEAT_S = 30.0
"""A sensor believed again twice within this time, or so early, is not what it is taken for."""
ADAPTED_READINGS_KEPT = 20.0
"""Readings learnt that are left after such a step, so that the level is found anew soon."""


@njit(cache=True, error_model="numpy")
def inflate_noise(row: Any, sensor: int, p: Any) -> None:
    """Blame a suspicion of `sensor` that comes back and back on what was learnt: noise, scale of the speed, walk."""
    mode_probability, own = row.mode_probability, OTHER_SENSOR * sensor
    if mode_probability[NOISE + own] + mode_probability[PAIR + 1 - sensor] + mode_probability[BOTH] > 0.5:
        most = p.noise.x_std_max_m if sensor == Z_POSITION else p.noise.v_std_max_mps
        row.noise.r[sensor] = min(NOISE_INFLATION * row.noise.r[sensor], most**2)
    elif sensor == Z_POSITION:
        if mode_probability[DRIFT] > mode_probability[BIAS]:
            add_speed_bias(
                row.noise, clip(row.single[SLOPE, DRIFT], -SPEED_BIAS_STEP_MAX_MPS, SPEED_BIAS_STEP_MAX_MPS), p.noise
            )
        else:
            row.noise.random_walk_density = clip(
                NOISE_INFLATION * row.noise.random_walk_density, INFLATED_RANDOM_WALK_MIN, p.noise.random_walk_max
            )


@njit(cache=True, error_model="numpy")
def fault_timeout(row: Any, mean: Any, reading: Any, dt_s: float, p: Any) -> bool:
    """Count how long each sensor has been suspected, and believe it again when that is too long; return whether so."""
    position_fault, speed_fault = sensor_fault_probability(row.mode_probability)
    row.fault_time_s[Z_POSITION] = row.fault_time_s[Z_POSITION] + dt_s if position_fault > 0.5 else 0.0
    row.fault_time_s[Z_SPEED] = row.fault_time_s[Z_SPEED] + dt_s if speed_fault > 0.5 else 0.0
    row.observed_s += dt_s
    limit_s = min(p.fault_time_max_s, p.fault_share_max * row.observed_s)
    x, v = row.fault_time_s[Z_POSITION] > limit_s, row.fault_time_s[Z_SPEED] > limit_s
    if not (x or v):
        return False
    repeated = row.t_s - row.last_reset_s < REPEAT_S
    row.last_reset_s = row.t_s
    for sensor in (Z_POSITION, Z_SPEED):
        if row.fault_time_s[sensor] > limit_s:
            row.fault_time_s[sensor] = 0.0
            if repeated:
                row.noise.adapted_readings = min(row.noise.adapted_readings, ADAPTED_READINGS_KEPT)
                inflate_noise(row, sensor, p)
    reset_to_measurement(row, x, v, mean, reading, row.noise.r, p.modes)
    return True
