"""Adaptive filtering: noise of both sensors, jerk of the driver, and how position and speed differ, from innovations.

All is adapted to innovations of readings with a high probability of HEALTHY. A variance moves on a logarithm, in steps
that are large at first:

    too wide      the share of innovations beyond a quartile of N(0, S), less 1/4 (Robbins and Monro 1951,
                  doi:10.1214/aoms/1177729586, on a quantile): sensor noise and motion noise together are too small
    same sign     product of two successive innovations above 0: the filter lags, so motion noise is too small and
                  sensor noise too large (Mehra 1970, doi:10.1109/TAC.1970.1099422)

The motion noise is jerk for the speed and a random walk for the position. A position that runs ahead of its prediction
by d m/s shows a speed bias beta, or a latency lambda of the reported speed, by recursive least squares:

    d = beta + lambda a + noise
"""

from math import copysign, exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED

QUARTILE = 1.1503493803760079
"""Quantile 7/8 of the standard normal: one value in four is beyond it, to either side."""
OUTLIER = 3.0
"""Standard deviations beyond which an innovation is clipped."""
RANDOM_WALK_PER_NOISE_HZ = 20.0
"""White noise of variance r makes displacements at 10 Hz as uncertain as a random walk of density 20 r."""

ADAPTED_NOISE = np.dtype(
    [
        ("r", "f8", (2,)),  # variance of position and speed readings
        ("jerk_density", "f8"),  # m^2/s^5
        ("speed_bias_mps", "f8"),  # beta: speed of the position less the reported speed
        ("speed_latency_s", "f8"),  # lambda: age of the reported speed relative to the position
        ("P_bias_latency", "f8", (3,)),  # (co)variances bb, bl, ll of both, relative to the noise of d
        ("random_walk_density", "f8"),  # of position less integral of speed, m^2/s
        ("adapted_readings", "f8"),
        ("nu", "f8", (2,)),  # previous innovations; 0: none
    ],
    align=True,
)


class NoiseAdaptationParams(NamedTuple):
    """Start, steps and limits of the adaptation. Values without another source: tuned on the pairs, ADR 0005."""

    x_std_m: float = 0.02
    v_std_mps: float = 0.02
    """Noise of a vehicle's sensors before it is known, m and m/s."""
    jerk_density: float = 0.3
    """Jerk density before it is known, m^2/s^5."""
    random_walk_density: float = 1e-4
    """Random-walk density before it is known, m^2/s: 3 mm a reading at 10 Hz."""
    std_min: float = 0.003
    """Least noise of either sensor, m or m/s: readings have a resolution of a centimetre (SAE J2735, Latitude)."""
    x_std_max_m: float = 10.0
    v_std_max_mps: float = 3.0
    """Largest noise, m and m/s."""
    jerk_density_min: float = 0.001
    jerk_density_max: float = 2.0
    """Limits of the jerk density, m^2/s^5; the first one scales with the unexplained share."""
    random_walk_min: float = 3e-6
    random_walk_max: float = 10.0
    """Limits of the random-walk density, m^2/s."""
    position_noise_floor: float = 6.4e-4
    """Least random walk and noise of a position together, as a density in m^2/s: 8 mm a reading (ADR 0006). A receiver
    that smooths its positions hides its noise, and the positions wander over seconds."""
    step_min: float = 0.02
    """Step on a logarithm at a reading once the noise has settled."""
    settling: float = 0.1
    """Before, the step is 1 / (1 + settling x adapted readings)."""
    sign_step: float = 0.5
    """First step by signs, of random walk against position noise; it settles likewise."""
    sign_step_min: float = 0.005
    """The same once settled."""
    sign_share: float = 0.5
    """Share of a step, of jerk against speed noise, that signs decide."""
    random_walk_observable: float = 0.5
    """Random-walk density, as a share of the position's variance in m^2, below which signs cannot show it, 1/s."""
    random_walk_decay: float = 0.01
    """Decay of such a density on the logarithm, per reading."""
    speed_bias_var0: float = 0.02
    speed_latency_var0: float = 0.002
    """Variances of beta and lambda before they are known, relative to that of d."""
    bias_latency_gain: float = 0.001
    """Least share of d that goes into beta and lambda at a reading."""
    speed_bias_max_mps: float = 2.0
    speed_latency_max_s: float = 0.3
    """Limits; the published follower has 1 m/s and 0.05 s (ADR 0005)."""


@njit(cache=True, error_model="numpy")
def initialise_noise(noise: Any, p: NoiseAdaptationParams) -> None:
    """Set the noise of a vehicle that is not known."""
    noise.r[Z_POSITION], noise.r[Z_SPEED] = p.x_std_m**2, p.v_std_mps**2
    noise.jerk_density, noise.random_walk_density = p.jerk_density, p.random_walk_density
    noise.speed_bias_mps, noise.speed_latency_s = 0.0, 0.0
    P = noise.P_bias_latency
    P[0], P[1], P[2] = p.speed_bias_var0, 0.0, p.speed_latency_var0
    noise.adapted_readings = 0.0
    reset_previous_innovation(noise)


@njit(cache=True, error_model="numpy")
def step_size(noise: Any, p: NoiseAdaptationParams) -> float:
    """Return how far one reading may move the logarithm of a variance."""
    return float(max(p.step_min, 1.0 / (1.0 + p.settling * noise.adapted_readings)))


@njit(cache=True, error_model="numpy")
def reset_previous_innovation(noise: Any) -> None:
    """Forget the previous innovation: the next one does not follow on it."""
    noise.nu[Z_POSITION], noise.nu[Z_SPEED] = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def quantile_and_sign(noise: Any, sensor: int, nu: float, s: float, sign_step: float) -> tuple[float, float]:
    """Return whether an innovation of variance `s` is too wide, less 1/4, and +- `sign_step` by the signs of two."""
    wide = (1.0 if abs(nu) > QUARTILE * sqrt(s) else 0.0) - 0.25
    product = noise.nu[sensor] * nu
    noise.nu[sensor] = nu
    return wide, copysign(sign_step, product) if product != 0.0 else 0.0


@njit(cache=True, error_model="numpy")
def adapt_noise(
    noise: Any, dt_s: float, a_mps2: float, nu: Any, cov: Any, unexplained: float, p: NoiseAdaptationParams
) -> None:
    """Adapt to the innovation `nu` (2,) of a healthy reading, with its covariance `cov` (3,) as xx, xv, vv.

    `unexplained` is the share of the driver's changes of acceleration that the leader does not explain.
    """
    r = noise.r
    step = step_size(noise, p)
    sign_step = max(p.sign_step_min, p.sign_step / (1.0 + p.settling * noise.adapted_readings)) / step
    noise.adapted_readings += 1.0
    x_wide, x_sign = quantile_and_sign(noise, Z_POSITION, nu[Z_POSITION], cov[0], sign_step)
    v_wide, v_sign = quantile_and_sign(noise, Z_SPEED, nu[Z_SPEED], cov[2], p.sign_share)
    r[Z_POSITION] = clip(r[Z_POSITION] * exp(step * (x_wide - x_sign)), p.std_min**2, p.x_std_max_m**2)
    r[Z_SPEED] = clip(r[Z_SPEED] * exp(step * (v_wide - v_sign)), p.std_min**2, p.v_std_max_mps**2)
    jerk_density_min = unexplained * p.jerk_density_min
    noise.jerk_density = clip(noise.jerk_density * exp(step * (v_wide + v_sign)), jerk_density_min, p.jerk_density_max)
    d_mps = (1.0 - r[Z_POSITION] / cov[0]) * clip_innovation(nu[Z_POSITION], cov[0]) / dt_s
    adapt_bias_and_latency(noise, d_mps, a_mps2, p)
    decay = p.random_walk_decay if noise.random_walk_density < p.random_walk_observable * r[Z_POSITION] else 0.0
    random_walk_min = max(p.random_walk_min, p.position_noise_floor - RANDOM_WALK_PER_NOISE_HZ * r[Z_POSITION])
    noise.random_walk_density = clip(
        noise.random_walk_density * exp(step * (x_wide + x_sign) - decay), random_walk_min, p.random_walk_max
    )


@njit(cache=True, error_model="numpy")
def adapt_bias_and_latency(noise: Any, d_mps: float, a_mps2: float, p: NoiseAdaptationParams) -> None:
    """Adapt beta and lambda to a position that ran ahead of its prediction by `d_mps`, in units of its own noise.

    h = [1, a]    K = P h / (1 + h' P h)    P <- P - K h' P + gain^2 I
    """
    P = noise.P_bias_latency
    ph_bias, ph_latency = P[0] + P[1] * a_mps2, P[1] + P[2] * a_mps2
    share = 1.0 / (1.0 + ph_bias + ph_latency * a_mps2)
    add_speed_bias(noise, share * ph_bias * d_mps, p)
    latency_s = noise.speed_latency_s + share * ph_latency * d_mps
    noise.speed_latency_s = clip(latency_s, -p.speed_latency_max_s, p.speed_latency_max_s)
    P[0] += p.bias_latency_gain**2 - share * ph_bias * ph_bias
    P[1] -= share * ph_bias * ph_latency
    P[2] += p.bias_latency_gain**2 - share * ph_latency * ph_latency


@njit(cache=True, error_model="numpy")
def add_speed_bias(noise: Any, change_mps: float, p: NoiseAdaptationParams) -> None:
    """Add `change_mps` to the speed bias, within its limits."""
    noise.speed_bias_mps = clip(noise.speed_bias_mps + change_mps, -p.speed_bias_max_mps, p.speed_bias_max_mps)


@njit(cache=True, error_model="numpy")
def clip_innovation(nu: float, s: float) -> float:
    """Return an innovation of variance `s`, at most OUTLIER standard deviations from 0."""
    limit = OUTLIER * sqrt(s)
    return clip(nu, -limit, limit)


@njit(cache=True, error_model="numpy")
def clip(value: float, low: float, high: float) -> float:
    """Return `value`, or the nearer of the two limits."""
    return min(max(value, low), high)
