"""The simulated follower of the published experiment, and the readings of its faulty sensors.

The driver follows the IDM of the filter, with the leader of tau ago. A random acceleration a_r ~ N(-0.65, 0.25^2) moves
the position by a_r tau dt per step, as a speed bias that the third state of Model 2 estimates. With a stochastic delay
(equation `stochastic-delay`) the leader is that of tau + kappa ago, kappa drawn for each sample with tau + kappa >= 0.
"""

from dataclasses import dataclass

import numpy as np
from numba import njit
from numpy.typing import NDArray

from headway.core.estimation.car_following import IdmParams, idm
from headway.core.runtime.rows import readings
from headway.core.types.records import Records
from headway_loadtest.evaluate.paper.leader import INTERVAL_S, Leader
from headway_loadtest.inject.faults import Spec, inject
from headway_loadtest.sources.drive import F64

LENGTH_M = 5.0
START_X_M, START_V_MPS = 5.0, 1.0
SLIP_MPS2, SLIP_STD_MPS2 = -0.65, 0.25
READING_STD = 0.01
"""Of location and speed, m and m/s; the filter has 0.1."""


@dataclass(frozen=True, slots=True)
class Follower:
    """The truth about one simulated follower, (n,) each, and its readings (READING) with the leader's beside them."""

    x_m: F64
    v_mps: F64
    readings: Records


@dataclass(frozen=True, slots=True)
class CorruptedReadings:
    """Readings with anomalies in them, (n,), and which rows have one in either sensor."""

    readings: Records
    anomalous: NDArray[np.bool_]


def drive(leader: Leader, delay_s: float, delay_jitter_s: float, seed: int) -> Follower:
    """Simulate the follower of `leader` and read his sensors."""
    n = len(leader.x_m)
    rng = np.random.default_rng(seed)
    speed_bias_mps = rng.normal(SLIP_MPS2, SLIP_STD_MPS2, n) * delay_s
    noise = rng.normal(0.0, READING_STD, (2, n))
    whole_samples = np.floor(delay_s / INTERVAL_S + 1e-9)
    lag = np.maximum(0.0, whole_samples + rng.normal(0.0, 1.0, n) * delay_jitter_s / INTERVAL_S)
    x_m, v_mps = follow(leader.x_m, leader.v_mps, lag, speed_bias_mps, IdmParams())
    made = readings(n)
    made["t_s"] = made["leader_t_s"] = leader.t_s
    made["leader_x_m"], made["leader_v_mps"], made["leader_length_m"] = leader.x_m, leader.v_mps, LENGTH_M
    made["x_m"], made["v_mps"] = x_m + noise[0], v_mps + noise[1]
    return Follower(x_m, v_mps, made)


def corrupt(follower: Follower, severity: float, seed: int) -> CorruptedReadings:
    """Inject Algorithm 1 with variance `severity`; equal seeds place equal events, whatever the severity.

    A short drive on which nothing happens is drawn again: it has no ROC.
    """
    clean = follower.readings
    rng = np.random.default_rng((seed, 1))
    corrupted = inject(rng, clean["x_m"], clean["v_mps"], Spec(c=severity))
    while not corrupted.anomalous.any():
        corrupted = inject(rng, clean["x_m"], clean["v_mps"], Spec(c=severity))
    made = clean.copy()
    made["x_m"], made["v_mps"] = corrupted.x_m, corrupted.v_mps
    return CorruptedReadings(made, corrupted.anomalous)


@njit(cache=True, error_model="numpy")
def follow(leader_x_m: F64, leader_v_mps: F64, lag_samples: F64, speed_bias_mps: F64, p: IdmParams) -> tuple[F64, F64]:
    """Return position and speed, (n,) each: v += dt f_v, x += dt (v + bias) with the new speed, v at least 0.

    `lag_samples` (n,) is the delay of the leader in samples. Between samples the leader is on the straight line, and
    before the first one it stands at the start.
    """
    n = leader_x_m.size
    x_m, v_mps = np.empty(n), np.empty(n)
    x_m[0], v_mps[0] = START_X_M, START_V_MPS
    for k in range(n - 1):
        delayed = max(0.0, k - lag_samples[k])
        i = int(delayed)
        j = min(i + 1, n - 1)
        w = delayed - i
        leader_x = (1.0 - w) * leader_x_m[i] + w * leader_x_m[j]
        leader_v = (1.0 - w) * leader_v_mps[i] + w * leader_v_mps[j]
        f, _, _, _ = idm(leader_x - x_m[k] - LENGTH_M, v_mps[k], leader_v, p)
        v_mps[k + 1] = max(0.0, v_mps[k] + INTERVAL_S * f)
        x_m[k + 1] = x_m[k] + INTERVAL_S * (v_mps[k + 1] + speed_bias_mps[k])
    return x_m, v_mps
