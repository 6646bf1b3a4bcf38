"""Three vehicles that declare their leader and its range: single readings are faulty, and later one vehicle has a
self-consistent fault, so both the filter and the pair tests raise events."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from sim.clock import START_US

NAMES = ["car0", "car1", "car2"]
LENGTH_M, GAP_M = 4.5, 25.0
CONSISTENT_FROM_S = 22.0


class Instant(NamedTuple):
    """The messages of the three vehicles, in the order of NAMES."""

    k: int
    t_us: int
    x_m: np.ndarray
    v_mps: np.ndarray
    range_m: np.ndarray
    """NaN for the first one."""


def drive(seed: int, seconds: float = 30.0) -> Iterator[Instant]:
    """Yield the instants, 0.1 s apart; some are lost."""
    rng = np.random.default_rng(seed)
    cars = len(NAMES)
    for k in range(round(seconds * 10)):
        t_s = 0.1 * k
        x_m = 1000.0 - (GAP_M + LENGTH_M) * np.arange(cars) + 20.0 * t_s + rng.normal(0, 0.02, cars)
        v_mps = 20.0 + rng.normal(0, 0.02, cars)
        if t_s > CONSISTENT_FROM_S:
            x_m[0] += 0.8 * (t_s - CONSISTENT_FROM_S)
            v_mps[0] += 0.8
        if 60 <= k < 140 and k % 9 < 3:
            x_m[k % cars] += rng.choice([-8.0, 12.0])
        if 100 <= k < 130:
            v_mps[2] += 4.0
        range_m = np.r_[np.nan, np.full(cars - 1, GAP_M) + rng.normal(0, 0.02, cars - 1)]
        if rng.random() > 0.03:
            yield Instant(k, START_US + 100_000 * k, x_m, v_mps, range_m)
