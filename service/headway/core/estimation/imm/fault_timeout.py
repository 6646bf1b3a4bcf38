"""Fault time-out: after a while a faulty sensor is reset to its reading, so that the filter is never locked out.

A position offset that does not end looks the same as an estimate that is wrong, and noise that does not end is the
sensor's own. So every fault ends with a reset. If the reset recurs soon, or comes early in a vehicle's life, the
adapted noise was wrong, and a large step corrects it.
"""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import (
    BIAS,
    BOTH_NOISE,
    DRIFT,
    NOISE,
    NOISE_BESIDE_OFFSET,
    sensor_fault_probability,
)
from headway.core.estimation.imm.noise_adaptation import clip
from headway.core.estimation.imm.speed_calibration import add_speed_excess
from headway.core.estimation.imm.state import reset_to_measurement
from headway.core.estimation.kinematics import AX, SLOPE, VX, Z_POSITION, Z_SPEED

NOISE_INFLATION = 16.0
"""Factor on a variance that was too small: four times the standard deviation. Tuned with the time-out (ADR 0005)."""
INFLATED_RANDOM_WALK_MIN = 1e-3
"""Least random-walk density after such a step, m^2/s: a centimetre a reading at 10 Hz."""
SPEED_BIAS_STEP_MAX_MPS = 1.0
"""Limit of such a step of the speed bias, m/s: the bias of the published follower (ADR 0005)."""
REPEAT_S = 30.0
"""Two resets within this time, or one within it of the first reading, put the adapted noise in doubt."""
ADAPTED_READINGS_KEPT = 20.0
"""Readings that count as adapted after such a step, so that noise settles again within seconds."""


@njit(cache=True, error_model="numpy")
def inflate_noise(row: Any, sensor: int, mean: Any, p: Any) -> None:
    """Correct the noise that causes repeated faults of `sensor`: its variance, the speed bias or the random walk."""
    mu = row.mode_probability
    if mu[NOISE[sensor]] + mu[NOISE_BESIDE_OFFSET[sensor]] + mu[BOTH_NOISE] > 0.5:
        std_max = p.noise.x_std_max_m if sensor == Z_POSITION else p.noise.v_std_max_mps
        row.noise.r[sensor] = min(NOISE_INFLATION * row.noise.r[sensor], std_max**2)
    elif sensor == Z_POSITION:
        if mu[DRIFT[sensor]] > mu[BIAS[sensor]]:
            slope_mps = row.single[SLOPE, DRIFT[sensor]]
            slope_mps = clip(slope_mps, -SPEED_BIAS_STEP_MAX_MPS, SPEED_BIAS_STEP_MAX_MPS)
            add_speed_excess(row.calibration, slope_mps, mean[VX], mean[AX], p.calibration)
        else:
            inflated = NOISE_INFLATION * row.noise.random_walk_density
            row.noise.random_walk_density = clip(inflated, INFLATED_RANDOM_WALK_MIN, p.noise.random_walk_max)


@njit(cache=True, error_model="numpy")
def fault_timeout(row: Any, mean: Any, reading: Any, r: Any, dt_s: float, p: Any) -> bool:
    """Count how long each sensor is faulty, reset it to its reading after the time-out, and return whether it was."""
    position_fault, speed_fault = sensor_fault_probability(row.mode_probability)
    row.fault_time_s[Z_POSITION] = row.fault_time_s[Z_POSITION] + dt_s if position_fault > 0.5 else 0.0
    row.fault_time_s[Z_SPEED] = row.fault_time_s[Z_SPEED] + dt_s if speed_fault > 0.5 else 0.0
    row.observed_s += dt_s
    limit_s = min(p.fault_time_max_s, p.fault_share_max * row.observed_s)
    position, speed = row.fault_time_s[Z_POSITION] > limit_s, row.fault_time_s[Z_SPEED] > limit_s
    if not (position or speed):
        return False
    repeated = row.t_s - row.last_reset_s < REPEAT_S
    row.last_reset_s = row.t_s
    for sensor in (Z_POSITION, Z_SPEED):
        if row.fault_time_s[sensor] > limit_s:
            row.fault_time_s[sensor] = 0.0
            if repeated:
                row.noise.adapted_readings = min(row.noise.adapted_readings, ADAPTED_READINGS_KEPT)
                inflate_noise(row, sensor, mean, p)
    reset_to_measurement(row, position, speed, mean, reading, r, p.modes)
    return True
