"""How noisy a vehicle's sensors are, how jerky its driver, how far its location and its speed go apart.

All is learnt from the innovations of readings that are taken for healthy, one number each on a logarithm, in steps that
are large at first. The share of innovations beyond a quartile tells whether a level is right, and an outlier weighs no
more than any other reading (Robbins-Monro on a quantile). The sensor's noise and the motion's own (jerk for the speed,
walk for the location) both widen an innovation; signs tell them apart: with too little of the motion's the filter lags
and innovations keep their sign, with too much they alternate (Mehra 1970, doi:10.1109/TAC.1970.1099422). A location
that keeps running ahead of its prediction slips beside the speed, or the speed is older than it: the one whatever the
car does, the other with its acceleration (recursive least squares).
"""

from math import copysign, exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED

QUARTILE = 1.1503493803760079
"""A standard normal goes beyond it, to either side, in one case of four."""

OUTLIER = 3.0
"""Standard deviations beyond which an innovation says no more than one of so many."""

RANDOM_WALK_PER_NOISE_HZ = 20.0
"""Noise of variance r makes displacements at 10 Hz as uncertain as a walk of density 20 r: r at either end of each."""

ADAPTED_NOISE = np.dtype(
    [
        ("r", "f8", (2,)),  # variance of location and speed readings
        ("jerk_density", "f8"),  # density of the jerk, m^2/s^5
        ("speed_bias_mps", "f8"),  # how much faster the location moves than the reported speed says, m/s
        ("speed_latency_s", "f8"),  # how old a reported speed is, beside the location
        (
            "P_bias_latency",
            "f8",
            (3,),
        ),  # (co)variances ss, sl, ll of slip and lag; 1: of what one location shows of both
        ("random_walk_density", "f8"),  # density of what location and speed differ by, m^2/s
        ("adapted_readings", "f8"),  # readings so far
        ("nu", "f8", (2,)),  # innovations one reading ago; 0: none
    ],
    align=True,
)


class NoiseAdaptationParams(NamedTuple):
    """Where the learning starts, how fast it is, and where it ends; std in m and m/s, densities as in LEVELS."""

    x_std_m: float
    v_std_mps: float
    jerk_density: float
    random_walk_density: float
    std_min: float
    x_std_max_m: float
    v_std_max_mps: float
    jerk_density_min: float
    jerk_density_max: float
    random_walk_min: float
    random_walk_max: float
    position_noise_floor: float
    """Walk and noise of a location together, as a walk, are never less: a location without noise of its own has been
    smoothed by its receiver, and wanders, in a way that is correlated over seconds."""
    step_min: float
    """Step on a logarithm per reading once all is settled;"""
    settling: float
    """before, it is 1 / (1 + settling * readings)."""
    sign_step: float
    """Part of a first step, on walk against location noise, that signs decide; it settles likewise,"""
    sign_step_min: float
    """to this step."""
    sign_share: float
    """Part of a step, on jerk against speed noise, that signs decide."""
    random_walk_observable: float
    """Walk per second, as a share of the variance of the location, below which signs cannot tell it from none;"""
    random_walk_decay: float
    """then it shrinks by this on the logarithm with each reading."""
    speed_bias_var0: float
    """Variance of slip,"""
    speed_latency_var0: float
    """and of lag before anything is heard, over that of what one location shows of them."""
    bias_latency_gain: float
    """Part of what the location runs ahead by that goes into slip and lag with each reading once they are known."""
    speed_bias_max_mps: float
    speed_latency_max_s: float


@njit(cache=True, error_model="numpy")
def initialise_noise(noise: Any, p: NoiseAdaptationParams) -> None:
    """Forget what was learnt."""
    noise.r[Z_POSITION], noise.r[Z_SPEED] = p.x_std_m**2, p.v_std_mps**2
    noise.jerk_density, noise.random_walk_density = p.jerk_density, p.random_walk_density
    noise.speed_bias_mps, noise.speed_latency_s = 0.0, 0.0
    noise.P_bias_latency[0], noise.P_bias_latency[1], noise.P_bias_latency[2] = (
        p.speed_bias_var0,
        0.0,
        p.speed_latency_var0,
    )
    noise.adapted_readings = 0.0
    reset_previous_innovation(noise)


@njit(cache=True, error_model="numpy")
def step_size(noise: Any, p: NoiseAdaptationParams) -> float:
    """Return how far, on a logarithm, one reading may move a level."""
    return float(max(p.step_min, 1.0 / (1.0 + p.settling * noise.adapted_readings)))


@njit(cache=True, error_model="numpy")
def reset_previous_innovation(noise: Any) -> None:
    """Say that the next innovation does not follow on the last one."""
    noise.nu[Z_POSITION], noise.nu[Z_SPEED] = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def quantile_and_sign(noise: Any, sensor: int, nu: float, s: float, sign_step: float) -> tuple[float, float]:
    """Return what an innovation says of both levels behind it together, and of the motion's against the sensor's."""
    wide = (1.0 if abs(nu) > QUARTILE * sqrt(s) else 0.0) - 0.25
    product = noise.nu[sensor] * nu
    noise.nu[sensor] = nu
    return wide, copysign(sign_step, product) if product != 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def adapt_noise(
    noise: Any, dt_s: float, a_mps2: float, nu: Any, cov: Any, unexplained: float, p: NoiseAdaptationParams
) -> None:
    """Take the innovation of a reading that is taken for healthy, with its variances.

    `unexplained` is the share of what the driver does that the car ahead does not announce.
    """
    step = step_size(noise, p)
    turn = max(p.sign_step_min, p.sign_step / (1.0 + p.settling * noise.adapted_readings)) / step
    noise.adapted_readings += 1.0
    x_wide, x_sign = quantile_and_sign(noise, Z_POSITION, nu[Z_POSITION], cov[0], turn)
    v_wide, v_sign = quantile_and_sign(noise, Z_SPEED, nu[Z_SPEED], cov[2], p.sign_share)
    noise.r[Z_POSITION] = clip(noise.r[Z_POSITION] * exp(step * (x_wide - x_sign)), p.std_min**2, p.x_std_max_m**2)
    noise.r[Z_SPEED] = clip(noise.r[Z_SPEED] * exp(step * (v_wide - v_sign)), p.std_min**2, p.v_std_max_mps**2)
    noise.jerk_density = clip(
        noise.jerk_density * exp(step * (v_wide + v_sign)), unexplained * p.jerk_density_min, p.jerk_density_max
    )
    excess_mps = (1.0 - noise.r[Z_POSITION] / cov[0]) * clip_innovation(nu[Z_POSITION], cov[0]) / dt_s
    adapt_bias_and_latency(noise, excess_mps, a_mps2, p)
    decay = p.random_walk_decay if noise.random_walk_density < p.random_walk_observable * noise.r[Z_POSITION] else 0.0
    random_walk_min = max(p.random_walk_min, p.position_noise_floor - RANDOM_WALK_PER_NOISE_HZ * noise.r[Z_POSITION])
    noise.random_walk_density = clip(
        noise.random_walk_density * exp(step * (x_wide + x_sign) - decay), random_walk_min, p.random_walk_max
    )


@njit(cache=True, error_model="numpy")
def adapt_bias_and_latency(noise: Any, excess_mps: float, a_mps2: float, p: NoiseAdaptationParams) -> None:
    """Take a location that ran ahead of its prediction by `excess_mps`: slip + lag a, and noise of unit variance."""
    c = noise.P_bias_latency
    gain_bias, gain_latency = c[0] + c[1] * a_mps2, c[1] + c[2] * a_mps2
    share = 1.0 / (1.0 + gain_bias + gain_latency * a_mps2)
    add_speed_bias(noise, share * gain_bias * excess_mps, p)
    noise.speed_latency_s = clip(
        noise.speed_latency_s + share * gain_latency * excess_mps, -p.speed_latency_max_s, p.speed_latency_max_s
    )
    c[0] += p.bias_latency_gain**2 - share * gain_bias * gain_bias
    c[1] -= share * gain_bias * gain_latency
    c[2] += p.bias_latency_gain**2 - share * gain_latency * gain_latency


@njit(cache=True, error_model="numpy")
def add_speed_bias(noise: Any, excess_mps: float, p: NoiseAdaptationParams) -> None:
    """Take locations to run ahead of the speed by `excess_mps` more."""
    noise.speed_bias_mps = clip(noise.speed_bias_mps + excess_mps, -p.speed_bias_max_mps, p.speed_bias_max_mps)


@njit(cache=True, error_model="numpy")
def clip_innovation(nu: float, s: float) -> float:
    """Return an innovation of variance `s`, and of an outlying one no more than counts."""
    most = OUTLIER * sqrt(s)
    return clip(nu, -most, most)


@njit(cache=True, error_model="numpy")
def clip(value: float, least: float, most: float) -> float:
    """Return `value`, or the nearer of the two limits."""
    return min(max(value, least), most)
