"""How a vehicle's reported speed and its positions differ although both sensors work: bias, scale and latency.

The position moves by a bias, a share of the speed and a latency times the acceleration beside the reported speed v:

    x' = v + bias + scale v + latency w'

Each of the three is learnt by separate-bias estimation (Friedland 1969, doi:10.1109/TAC.1969.1099223): the filter runs
without them, `sensitivity` tells by how much its predicted position would grow with each, and its position innovation,
of variance s, is the measurement. With c the sensitivity and P the covariance of the three,

    K = P c / (s + c' P c)        b <- b + K nu        P <- P - K c' P

What is corrected at once is the position that the filter is given (`step`). No value leaves what receivers are.

A position of age D lags the integral of the speed by D times w, the mean speed of the last D seconds. For a speed that
changes steadily w is that of D / 2 ago, so it follows the speed with that time constant. A position that is newer than
the speed cannot be predicted better than by w = v.

The sensitivity to the latency is a change of speed since the positions that still count. Noise of the speed makes such
changes too, and would show a false latency. So only that part of it counts in the gain that noise does not explain.
"""

from math import exp, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.imm.noise_adaptation import OUTLIER, clip

BIAS, LATENCY, SCALE = range(3)
ROUNDING_MPS = 1e-6
CHANGE_MIN = 1e-12
"""Least squared change of a speed, m^2/s^2: it only keeps a quotient finite."""
HELD_KEPT = 0.995
"""What is left of `speed_held` with each change of the speed."""
LAG_MIN_S = 0.001
"""Shorter lags of w are none."""
RESTING_MPS = 0.5
"""Speed below which the bias is another: most sensors of speed have none at rest."""

CALIBRATION = np.dtype(
    [
        ("bias_mps", "f8"),  # at rest, or in motion: as the vehicle is now
        ("resting", "i4"),  # whether it is at rest
        ("speed_held", "f4"),  # from 0 to 1: 1 where the speed repeats itself in motion, and fades with each change
        ("other_bias_mps", "f8"),  # in motion, or at rest
        ("other_bias_variance", "f8"),
        ("latency_s", "f8"),  # how old the reported speed is beside the position; below 0: the position is older
        ("scale", "f8"),  # what the reported speed lacks, as a share of it
        ("P", "f8", (6,)),  # their covariance: bb, bl, ll, bs, ls, ss
        ("sensitivity", "f8", (3,)),  # of the filter's predicted position to the three
        ("mean_speed_mps", "f8"),  # w: of the time by which positions are older than speeds
        ("mean_speed_gain", "f8"),  # share of the newest change of the speed that is in it
        ("repeat_share", "f8"),  # share of messages of the moving vehicle that repeat the last position
        ("repeat_interval_s", "f8"),  # time between a position and its repetition; 0: none was repeated
        ("speed_step_mps", "f8"),  # smallest difference of two reported speeds; 0: not known
        ("last_speed_mps", "f8"),
        ("dead_zone_mps", "f8"),  # speed below which 0 may be reported
    ],
    align=True,
)


class CalibrationParams(NamedTuple):
    """Standard deviations before any reading, random walks per reading, and the limits of what receivers are."""

    bias_std_mps: float = 0.15
    latency_std_s: float = 0.15
    scale_std: float = 0.005
    """Wheel speeds are 1 to 3 % off, positions 0.1 to 0.5 s older than speeds. A scale that is larger shows as a bias
    first (ADR 0011)."""
    bias_walk_mps: float = 3e-5
    latency_walk_s: float = 5e-5
    scale_walk: float = 3e-6
    bias_max_mps: float = 2.0
    """The published follower has 1 m/s (ADR 0005)."""
    latency_max_s: float = 1.0
    scale_max: float = 0.05
    speed_step_max_mps: float = 0.45
    """One mile per hour."""
    dead_zone_mps: float = 0.4
    """Speed below which a sensor may report 0, until a slower one was reported (ADR 0005)."""
    dead_zone_min_mps: float = 0.15
    """Slower ones may be noise at rest."""
    latency_share: float = 0.1
    """Least standard deviation of the latency, as a share of it: it is modelled to first order."""
    change_std: float = 4.0
    """Standard deviations of a speed up to which its change shows nothing of the latency."""
    held_variance: float = 1.0 / 12.0
    """Least variance of the bias, as a share of the squared step in which a held speed is reported: its rounding."""
    speed_step_growth: float = 1.02
    """Factor by which the step grows with each change of the speed, so that a wrong one is forgotten."""


@njit(cache=True, error_model="numpy")
def initialise_calibration(calibration: Any, p: CalibrationParams) -> None:
    """Forget what was learnt."""
    calibration.bias_mps = calibration.latency_s = calibration.scale = 0.0
    calibration.other_bias_mps, calibration.other_bias_variance = 0.0, p.bias_std_mps**2
    calibration.P[:] = 0.0
    calibration.P[0], calibration.P[2], calibration.P[5] = p.bias_std_mps**2, p.latency_std_s**2, p.scale_std**2
    calibration.sensitivity[:] = 0.0
    calibration.speed_step_mps = calibration.repeat_share = calibration.repeat_interval_s = 0.0
    calibration.speed_held = 0.0
    calibration.dead_zone_mps = p.dead_zone_mps


@njit(cache=True, error_model="numpy")
def predict_calibration(calibration: Any, dt_s: float, v_mps: float, a_mps2: float) -> float:
    """Return how far the position moves beside the reported speed in `dt_s`."""
    c = calibration.sensitivity
    resting = 1 if v_mps < RESTING_MPS else 0
    if calibration.resting != resting:
        calibration.resting = resting
        _exchange_bias(calibration)
    change_mps = _advance_mean_speed(calibration, dt_s, v_mps, a_mps2)
    c[BIAS] += dt_s
    c[LATENCY] += change_mps
    c[SCALE] += v_mps * dt_s
    return float((calibration.bias_mps + calibration.scale * v_mps) * dt_s + calibration.latency_s * change_mps)


@njit(cache=True, error_model="numpy")
def _advance_mean_speed(calibration: Any, dt_s: float, v_mps: float, a_mps2: float) -> float:
    """Return by how much w changes in `dt_s`, from the speed `v_mps` on: that of a first-order lag at a ramp."""
    lag_s = max(-0.5 * calibration.latency_s, 0.0)
    lag_s = lag_s if lag_s > LAG_MIN_S else 0.0
    reached = 1.0 - exp(-dt_s / lag_s) if lag_s > 0.0 else 1.0
    calibration.mean_speed_gain = 1.0 - lag_s * reached / dt_s
    change_mps = reached * (v_mps - calibration.mean_speed_mps) + calibration.mean_speed_gain * a_mps2 * dt_s
    calibration.mean_speed_mps += change_mps
    return float(change_mps)


@njit(cache=True, error_model="numpy")
def correct_mean_speed(calibration: Any, change_mps: float, kept: float) -> float:
    """Take a change of the speed that the reading showed; return how far it moves the position beside the speed.

    `kept` is the share of the predicted position in the filter's.
    """
    change_mps *= calibration.mean_speed_gain
    calibration.mean_speed_mps += change_mps
    calibration.sensitivity[LATENCY] += kept * change_mps
    return float(kept * calibration.latency_s * change_mps)


@njit(cache=True, error_model="numpy")
def _exchange_bias(calibration: Any) -> None:
    """Exchange the bias at rest and that in motion."""
    P, bias_mps, variance = calibration.P, calibration.bias_mps, calibration.P[0]
    calibration.bias_mps, P[0] = calibration.other_bias_mps, calibration.other_bias_variance
    calibration.other_bias_mps, calibration.other_bias_variance = bias_mps, variance
    P[1] = P[3] = calibration.sensitivity[BIAS] = 0.0


@njit(cache=True, error_model="numpy")
def update_calibration(calibration: Any, nu: float, s: float, speed_variance: float, p: CalibrationParams) -> float:
    """Take a position innovation of variance `s`; return by how much the predicted position is corrected.

    `speed_variance` is that of a reported speed, m^2/s^2.
    """
    P, c = calibration.P, calibration.sensitivity
    change_mps = c[LATENCY]
    certain = change_mps * max(0.0, 1.0 - p.change_std**2 * speed_variance / max(change_mps**2, CHANGE_MIN))
    rounding = p.held_variance * calibration.speed_held * calibration.speed_step_mps**2
    P[0] = min(max(P[0] + p.bias_walk_mps**2, rounding), p.bias_std_mps**2)
    P[2] = min(max(P[2] + p.latency_walk_s**2, (p.latency_share * calibration.latency_s) ** 2), p.latency_std_s**2)
    P[5] = min(P[5] + p.scale_walk**2, p.scale_std**2)
    bias = P[0] * c[BIAS] + P[1] * certain + P[3] * c[SCALE]
    latency = P[1] * c[BIAS] + P[2] * certain + P[4] * c[SCALE]
    scale = P[3] * c[BIAS] + P[4] * certain + P[5] * c[SCALE]
    total = s + c[BIAS] * bias + certain * latency + c[SCALE] * scale
    bound = OUTLIER * sqrt(total)
    weighted = clip(nu, -bound, bound) / total
    before = displacement(calibration)
    calibration.bias_mps = clip(calibration.bias_mps + weighted * bias, -p.bias_max_mps, p.bias_max_mps)
    calibration.latency_s = clip(calibration.latency_s + weighted * latency, -p.latency_max_s, p.latency_max_s)
    calibration.scale = clip(calibration.scale + weighted * scale, -p.scale_max, p.scale_max)
    P[0] -= bias * bias / total
    P[1] -= bias * latency / total
    P[2] -= latency * latency / total
    P[3] -= bias * scale / total
    P[4] -= latency * scale / total
    P[5] -= scale * scale / total
    return displacement(calibration) - before


@njit(cache=True, error_model="numpy")
def calibration_variance(calibration: Any) -> float:
    """Return the variance of the predicted position that the three leave, m^2 (Schmidt's consider filter)."""
    P, c = calibration.P, calibration.sensitivity
    cross = P[1] * c[BIAS] * c[LATENCY] + P[3] * c[BIAS] * c[SCALE] + P[4] * c[LATENCY] * c[SCALE]
    return float(P[0] * c[BIAS] ** 2 + P[2] * c[LATENCY] ** 2 + P[5] * c[SCALE] ** 2 + 2.0 * cross)


@njit(cache=True, error_model="numpy")
def displacement(calibration: Any) -> float:
    """Return what the three contribute to the predicted position, m."""
    c = calibration.sensitivity
    return float(c[BIAS] * calibration.bias_mps + c[LATENCY] * calibration.latency_s + c[SCALE] * calibration.scale)


@njit(cache=True, error_model="numpy")
def add_speed_excess(calibration: Any, excess_mps: float, v_mps: float, a_mps2: float, p: CalibrationParams) -> None:
    """Take positions to run ahead of the speed by `excess_mps` more: each of the three by its share of the variance."""
    bias, latency, scale = p.bias_std_mps**2, p.latency_std_s**2 * a_mps2, p.scale_std**2 * v_mps
    weighted = excess_mps / (bias + latency * a_mps2 + scale * v_mps)
    calibration.bias_mps = clip(calibration.bias_mps + weighted * bias, -p.bias_max_mps, p.bias_max_mps)
    calibration.latency_s = clip(calibration.latency_s + weighted * latency, -p.latency_max_s, p.latency_max_s)
    calibration.scale = clip(calibration.scale + weighted * scale, -p.scale_max, p.scale_max)


@njit(cache=True, error_model="numpy")
def observe_dead_zone(calibration: Any, v_mps: float, p: CalibrationParams) -> None:
    """Take a healthy speed: a sensor that reports such a slow one has no dead zone above it."""
    if p.dead_zone_min_mps < v_mps < calibration.dead_zone_mps:
        calibration.dead_zone_mps = v_mps


@njit(cache=True, error_model="numpy")
def observe_speed_step(calibration: Any, v_mps: float, p: CalibrationParams) -> bool:
    """Take the next reported speed: the smallest change above zero is the step in which speeds are reported."""
    change = abs(v_mps - calibration.last_speed_mps)
    calibration.last_speed_mps = v_mps
    if change <= ROUNDING_MPS:
        if v_mps > RESTING_MPS:
            calibration.speed_held = 1.0
        return False
    calibration.speed_held *= HELD_KEPT
    known = calibration.speed_step_mps if calibration.speed_step_mps > 0.0 else p.speed_step_max_mps
    calibration.speed_step_mps = min(change, p.speed_step_growth * known, p.speed_step_max_mps)
    return True
