"""Adaptive filtering: noise of both sensors, jerk of the driver, and how position and speed differ, from innovations.

All is adapted to innovations of readings with a high probability of HEALTHY. A variance moves on a logarithm, in steps
that are large at first:

    too wide      the share of innovations beyond a quartile of N(0, S), less 1/4 (Robbins and Monro 1951,
                  doi:10.1214/aoms/1177729586, on a quantile): sensor noise and motion noise together are too small
    same sign     product of two successive innovations above 0: the filter lags, so motion noise is too small and
                  sensor noise too large (Mehra 1970, doi:10.1109/TAC.1970.1099422)

The motion noise is jerk for the speed and a random walk for the position. A time stamp with a random error moves the
position by the speed times that error. Over the speeds of roads the variance is then close to

    r_x(v) = r_x exp(growth v / (v + HALF_GROWTH_MPS))
"""

from math import exp, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.kinematics import Z_POSITION, Z_SPEED

QUARTILE = 1.1503493803760079
"""Quantile 7/8 of the standard normal: one value in four is beyond it, to either side."""
SIGN_COUNTS = 0.05
"""Product of two innovations, as a share of the variance, from which its sign counts in full."""
RECEIVER_READINGS = 10.0
"""Readings before which it is not known whether a sensor is a receiver."""
OUTLIER = 3.0
"""Standard deviations beyond which an innovation is clipped."""
RANDOM_WALK_PER_NOISE_HZ = 20.0
"""White noise of variance r makes displacements at 10 Hz as uncertain as a random walk of density 20 r."""

HALF_GROWTH_MPS = 4.0
"""Speed with half of the growth, on the logarithm: the best fit to v^2 between 1 and 30 m/s."""
SETTLED_READINGS = 100.0
"""Adapted readings from which the noise has settled (ADR 0006)."""
MANOEUVRE_GAIN_EARLY = 0.1
"""Gain of the manoeuvre probability as a share of the step, until the noise has settled."""

ADAPTED_NOISE = np.dtype(
    [
        ("r", "f8", (2,)),  # variance of position and speed readings
        ("jerk_density", "f8"),  # m^2/s^5
        ("position_noise_growth", "f8"),  # logarithm of how much noisier positions are in fast motion than at rest
        ("manoeuvre", "f8"),  # probability that a reading belongs to a manoeuvre
        ("random_walk_density", "f8"),  # of position less integral of speed, m^2/s
        ("adapted_readings", "f8"),  # in motion
        ("standing_readings", "f8"),  # adapted as well, at a standstill
        ("moving", "i8"),  # whether it was at the newest reading
        ("nu", "f8", (2,)),  # previous innovations; 0: none
        ("receiver", "f8"),  # from 0 to 1, how much the noise is that of a receiver and not of rounding
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
    position_noise_floor: float = 3e-4
    """Least random walk and noise of a position together, as a density in m^2/s: 5 mm a reading."""
    receiver_noise_floor: float = 4.5e-4
    """The same for a receiver: 7 mm a reading. One that smooths its positions hides its noise, and the
    positions wander over seconds."""
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
    random_walk_share_min: float = 0.011
    """Least random-walk density, as a share of the position's variance, 1/s: at 10 Hz, positions of more than some 3 s
    ago do not count. Speed bias, scale and latency are never known so well that they could (ADR 0011)."""
    position_noise_growth_min: float = -1.0
    position_noise_growth_decay: float = 0.03
    position_noise_growth_max: float = 9.0
    """A centimetre at rest and 0.6 m at 20 m/s: time stamps with a random error of 30 ms."""
    manoeuvre: float = 0.005
    manoeuvre_min: float = 0.003
    manoeuvre_max: float = 0.05
    """Probability that a reading belongs to a manoeuvre: before the driver is known, and its limits."""
    manoeuvre_gain: float = 0.003
    """Share of the newest reading in it."""
    moving_mps: float = 1.0
    """Below this speed a vehicle stands, and shows nothing of its sensors in motion, m/s."""
    rounding_x_m: float = 0.03
    rounding_v_mps: float = 0.012
    rounding_random_walk_m: float = 0.003
    """Noise of positions and speeds, and walk of positions in 0.1 s, up to which all may be rounding of messages."""
    receiver_ratio: float = 1.5
    """Multiple of one of them from which a sensor is a receiver."""
    receiver_gain: float = 0.01
    """Share of the newest reading in that."""
    standing_std_min: float = 0.01
    standing_jerk_density_min: float = 0.1
    """Limits at a standstill, m or m/s and m^2/s^5: positions and speeds that do not change at all are of no noise."""


@njit(cache=True, error_model="numpy")
def initialise_noise(noise: Any, p: NoiseAdaptationParams) -> None:
    """Set the noise of a vehicle that is not known."""
    noise.r[Z_POSITION], noise.r[Z_SPEED] = p.x_std_m**2, p.v_std_mps**2
    noise.jerk_density, noise.random_walk_density = p.jerk_density, p.random_walk_density
    noise.position_noise_growth, noise.manoeuvre = 0.0, p.manoeuvre
    noise.adapted_readings = noise.standing_readings = 0.0
    noise.moving = 0
    noise.receiver = 0.0
    reset_previous_innovation(noise)


@njit(cache=True, error_model="numpy")
def step_size(noise: Any, p: NoiseAdaptationParams) -> float:
    """Return how far one reading may move the logarithm of a variance."""
    return float(max(p.step_min, 1.0 / (1.0 + p.settling * settled_readings(noise))))


@njit(cache=True, error_model="numpy")
def settled_readings(noise: Any) -> float:
    """Return the adapted readings that count: those at a standstill only while the vehicle stands."""
    return float(noise.adapted_readings + (0.0 if noise.moving else noise.standing_readings))


@njit(cache=True, error_model="numpy")
def growth_share(v_mps: float) -> float:
    """Return the share of the growth of position noise at a speed."""
    v = max(v_mps, 0.0)
    return v / (v + HALF_GROWTH_MPS)


@njit(cache=True, error_model="numpy")
def position_variance(noise: Any, v_mps: float) -> float:
    """Return the variance of a position reading at a speed, m^2."""
    return float(noise.r[Z_POSITION] * exp(noise.position_noise_growth * growth_share(v_mps)))


@njit(cache=True, error_model="numpy")
def update_receiver(noise: Any, r: Any, p: NoiseAdaptationParams) -> None:
    """Update how much the noise, `r` (2,) at this reading, is more than the rounding of messages: that of a receiver.

    A position that is not measured at each message has an infinite variance, and is that of a receiver.
    """
    x, v = r[Z_POSITION] / p.rounding_x_m**2, r[Z_SPEED] / p.rounding_v_mps**2
    random_walk = 0.1 * noise.random_walk_density / p.rounding_random_walk_m**2
    share = clip(0.5 * log(max(x, v, random_walk)) / log(p.receiver_ratio), 0.0, 1.0)
    gain = max(p.receiver_gain, 1.0 / (RECEIVER_READINGS + settled_readings(noise)))
    noise.receiver += gain * (share - noise.receiver)


@njit(cache=True, error_model="numpy")
def reset_previous_innovation(noise: Any) -> None:
    """Forget the previous innovation: the next one does not follow on it."""
    noise.nu[Z_POSITION], noise.nu[Z_SPEED] = 0.0, 0.0


@njit(cache=True, error_model="numpy")
def quantile_and_sign(noise: Any, sensor: int, nu: float, s: float, sign_step: float) -> tuple[float, float]:
    """Return whether an innovation of variance `s` is too wide, less 1/4, and +- `sign_step` by the signs of two.

    The sign of a product that is small beside the variance counts less: noise that is far too wide would keep itself.
    """
    wide = (1.0 if abs(nu) > QUARTILE * sqrt(s) else 0.0) - 0.25
    product = noise.nu[sensor] * nu
    noise.nu[sensor] = nu
    return wide, clip(product / (SIGN_COUNTS * s), -1.0, 1.0) * sign_step


@njit(cache=True, error_model="numpy")
def adapt_noise(
    noise: Any,
    r_now: Any,
    v_mps: float,
    nu: Any,
    cov: Any,
    motion: Any,
    manoeuvring: float,
    measured: bool,
    changed: bool,
    p: NoiseAdaptationParams,
) -> None:
    """Adapt to the innovation `nu` (2,) of a healthy reading, with its covariance `cov` (3,) as xx, xv, vv.

    `motion` is the Motion before the reading, `manoeuvring` the probability that it belongs to a manoeuvre, `measured`
    whether it has a new position.
    """
    r, unexplained = noise.r, motion.unexplained
    noise.moving = 1 if v_mps > p.moving_mps else 0
    std_min, jerk_density_min = p.std_min, unexplained * p.jerk_density_min
    if noise.moving:
        noise.adapted_readings += 1.0
    else:
        noise.standing_readings += 1.0
        std_min, jerk_density_min = p.standing_std_min, max(jerk_density_min, p.standing_jerk_density_min)
    step = step_size(noise, p)
    sign_step = max(p.sign_step_min, p.sign_step / (1.0 + p.settling * settled_readings(noise))) / step
    v_wide, v_sign = quantile_and_sign(noise, Z_SPEED, nu[Z_SPEED], cov[2], p.sign_share)
    if changed:
        r[Z_SPEED] = clip(r[Z_SPEED] * exp(step * (v_wide - v_sign)), std_min**2, p.v_std_max_mps**2)
        jerk_density = noise.jerk_density * exp(step * (v_wide + v_sign))
        noise.jerk_density = clip(jerk_density, jerk_density_min, p.jerk_density_max)
    gain = max(p.manoeuvre_gain, MANOEUVRE_GAIN_EARLY * step)
    manoeuvre = noise.manoeuvre + gain * (manoeuvring / unexplained - noise.manoeuvre)
    noise.manoeuvre = clip(manoeuvre, p.manoeuvre_min, p.manoeuvre_max)
    update_receiver(noise, r_now, p)
    if not measured:
        return
    x_wide, x_sign = quantile_and_sign(noise, Z_POSITION, nu[Z_POSITION], cov[0], sign_step)
    variance, before = position_variance(noise, v_mps), r[Z_POSITION]
    r[Z_POSITION] = clip(before * exp(step * (x_wide - x_sign)), std_min**2, p.x_std_max_m**2)
    # In motion, the noise at rest changes alike; at rest, that in fast motion stays.
    growth = noise.position_noise_growth - (1.0 - growth_share(v_mps)) * log(r[Z_POSITION] / before)
    noise.position_noise_growth = clip(growth, p.position_noise_growth_min, p.position_noise_growth_max)
    if noise.moving:
        # Without a reason to differ, the noise at rest is that in motion.
        decay = p.position_noise_growth_decay * step * noise.position_noise_growth
        noise.position_noise_growth -= decay
        r[Z_POSITION] *= exp(decay * growth_share(v_mps))
    decay = p.random_walk_decay if noise.random_walk_density < p.random_walk_observable * variance else 0.0
    floor = p.position_noise_floor + noise.receiver * (p.receiver_noise_floor - p.position_noise_floor)
    random_walk_min = max(
        p.random_walk_min,
        floor - RANDOM_WALK_PER_NOISE_HZ * r[Z_POSITION],
        p.random_walk_share_min * variance,
    )
    noise.random_walk_density = clip(
        noise.random_walk_density * exp(step * (x_wide + x_sign) - decay), random_walk_min, p.random_walk_max
    )


@njit(cache=True, error_model="numpy")
def clip_innovation(nu: float, s: float) -> float:
    """Return an innovation of variance `s`, at most OUTLIER standard deviations from 0."""
    limit = OUTLIER * sqrt(s)
    return clip(nu, -limit, limit)


@njit(cache=True, error_model="numpy")
def clip(value: float, low: float, high: float) -> float:
    """Return `value`, or the nearer of the two limits."""
    return min(max(value, low), high)
