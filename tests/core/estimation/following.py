"""A follower with a known driver, for the tests between two cars."""

from collections.abc import Callable

import numpy as np

from headway.core.types.records import READING

Speed = Callable[[np.ndarray], np.ndarray]
LENGTH_M = 5.0
START_S = 1.6e9


def wave(t_s: np.ndarray) -> np.ndarray:
    """A leader who never drives at one speed for long, m/s."""
    return 12.0 + 2.5 * np.sin(0.19 * t_s) + 1.5 * np.sin(0.53 * t_s + 1.0)


def follow(seconds: float, rng: np.random.Generator, leader: Speed = wave, noise: float = 0.02) -> np.ndarray:
    """READING (n,) at 10 Hz of a linear driver: dv/dt = 0.05 (gap - 1.5 v) + 0.5 (v_leader - v), 0.4 s late."""
    t = np.arange(0.0, seconds, 0.1)
    v_leader = leader(t)
    x_leader = np.cumsum(0.1 * v_leader) + 30.0
    x, v = np.zeros(t.size), np.zeros(t.size)
    v[0] = v_leader[0]
    for k in range(1, t.size):
        late = max(k - 4, 0)
        gap = x_leader[late] - LENGTH_M - x[late]
        v[k] = max(v[k - 1] + 0.1 * (0.05 * (gap - 1.5 * v[late]) + 0.5 * (v_leader[late] - v[late])), 0.0)
        x[k] = x[k - 1] + 0.05 * (v[k] + v[k - 1])
    readings = np.zeros(t.size, READING)
    readings["t_s"] = readings["leader_t_s"] = START_S + t
    readings["x_m"], readings["leader_x_m"] = x, x_leader
    readings["v_mps"] = v + rng.normal(0.0, noise, t.size)
    readings["leader_v_mps"] = v_leader + rng.normal(0.0, noise, t.size)
    readings["leader_length_m"] = LENGTH_M
    readings["range_m"], readings["range_rate_mps"] = np.nan, np.nan
    return readings


def dip(n: int, depth_mps: float = 3.0) -> tuple[np.ndarray, np.ndarray]:
    """Speed and location of a feigned brake over 4 s, then silence up to n samples."""
    t = np.minimum(0.1 * np.arange(n), 4.0)
    speed = -0.5 * depth_mps * (1.0 - np.cos(0.5 * np.pi * t))
    return speed, np.cumsum(0.1 * speed)
