"""What the default model has learnt of the sensors of vehicles, in the units of their readings.

Nothing here is an alarm. Readings beyond the limits of receivers are the plausibility checks' to observe.
"""

import numpy as np

from headway.core.estimation.imm.noise_adaptation import HALF_GROWTH_MPS, SETTLED_READINGS
from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED
from headway.core.types.records import Records
from headway.core.types.sensor_quality import SensorQualities

FAST_MPS = 20.0
"""Speed at which the growth of position noise shows the scatter of time stamps."""


def sensor_qualities(rows: Records) -> SensorQualities:
    """Return what is known of each of the `rows` (n,) of `headway_dtype`; NaN before it has settled."""
    noise, calibration = rows["noise"], rows["calibration"]
    position_variance = noise["r"][:, Z_POSITION]
    growth = np.exp(noise["position_noise_growth"] * FAST_MPS / (FAST_MPS + HALF_GROWTH_MPS))
    unknown = np.where(noise["adapted_readings"] > SETTLED_READINGS, 0.0, np.nan)
    return SensorQualities(
        position_noise_m=np.sqrt(position_variance) + unknown,
        position_wander_mps=np.sqrt(noise["random_walk_density"]) + unknown,
        position_age_s=-calibration["latency_s"] + unknown,
        repeated_share=calibration["repeat_share"] + unknown,
        speed_noise_mps=np.sqrt(noise["r"][:, Z_SPEED]) + unknown,
        speed_bias_mps=np.where(calibration["resting"], calibration["other_bias_mps"], calibration["bias_mps"])
        + unknown,
        speed_scale=calibration["scale"] + unknown,
        speed_step_mps=calibration["speed_step_mps"] + unknown,
        clock_jitter_s=np.sqrt(np.maximum(position_variance * (growth - 1.0), 0.0)) / FAST_MPS + unknown,
    )
