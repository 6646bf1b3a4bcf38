"""Cars in a row: real pairs that chain into platoons, and platoons of drivers that are not the filter's model."""

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import permutations
from pathlib import Path

import numpy as np

from headway_loadtest.inject.faults import F64

SAMPLE_S = 0.1
LENGTH_M = 5.0
LEAST_APART_M = 2.0
"""Front to front all along the drive; nearer, it is the same car."""
MOST_APART = 1.5
"""Largest distance between two pairs, in mean distances within them; beyond it, an unrecorded car is between."""


@dataclass(frozen=True, slots=True)
class Platoon:
    """`m` cars on one road, the first ahead. Shapes: t_s (n,), x_m and v_mps (n, m), length_m (m,). SI units."""

    group: str
    t_s: F64
    x_m: F64
    v_mps: F64
    length_m: F64


def read_pair(path: Path) -> Platoon:
    """Read a pair file (`t_s,leader_x_m,follower_x_m,leader_v_mps,follower_v_mps,leader_length_m`) as two cars.

    The follower's length is not known and taken to be its leader's.
    """
    t_s, x_0, x_1, v_0, v_1, length_m = np.loadtxt(path, delimiter=",", skiprows=1, unpack=True)
    return Platoon(path.parent.name, t_s, np.stack([x_0, x_1], 1), np.stack([v_0, v_1], 1), length_m[[0, 0]])


def chain(pairs: Iterable[Platoon]) -> list[Platoon]:
    """Join pairs of one drive into platoons of four: the leader of the second drives right behind the first's follower.

    Pairs of one drive have the same group, the same times and one coordinate.
    """
    return [
        Platoon(
            f"{first.group}-platoon",
            first.t_s,
            np.hstack([first.x_m, second.x_m]),
            np.hstack([first.v_mps, second.v_mps]),
            np.concatenate([first.length_m, second.length_m]),
        )
        for first, second in permutations(pairs, 2)
        if first.group == second.group and np.array_equal(first.t_s, second.t_s) and is_right_behind(first, second)
    ]


def is_right_behind(first: Platoon, second: Platoon) -> bool:
    """Whether the first car of `second` follows the last of `first`, at the same times, with no car between."""
    apart_m = first.x_m[:, -1] - second.x_m[:, 0]
    within_m = -np.concatenate([np.diff(first.x_m), np.diff(second.x_m)])
    return bool(apart_m.min() > LEAST_APART_M and apart_m.mean() < MOST_APART * within_m.mean())


def synthetic(rng: np.random.Generator, seconds: float, cars: int = 4) -> Platoon:
    """Draw a platoon of full-velocity-difference drivers (Jiang, Wu, Zhu 2001, doi:10.1103/PhysRevE.64.017101).

    dv/dt = kappa (V(gap) - v) + lambda (v_leader - v), all as it was a reaction time ago, with drivers who differ and
    whose attention wanders (an Ornstein-Uhlenbeck acceleration). The first car keeps to a wish that changes now and
    then.
    """
    n, dt = round(seconds / SAMPLE_S), SAMPLE_S
    top_mps, kappa, lam = rng.uniform(14, 20, cars), rng.uniform(0.15, 0.4, cars), rng.uniform(0.3, 0.6, cars)
    late = rng.integers(4, 11, cars)
    x_m, v_mps = np.zeros((n, cars)), np.zeros((n, cars))
    x_m[0] = -18.0 * np.arange(cars)
    v_mps[0] = 8.0
    wander = np.zeros(cars)
    wish_mps = 8.0
    for k in range(1, n):
        wander += dt * -0.5 * wander + np.sqrt(dt) * rng.normal(0.0, 0.15, cars)
        if rng.random() < dt / 15.0:
            wish_mps = rng.uniform(3.0, 15.0)
        a_mps2 = wander.copy()
        a_mps2[0] += np.clip(0.5 * (wish_mps - v_mps[k - 1, 0]), -2.5, 1.5)
        for car in range(1, cars):
            then = max(k - 1 - late[car], 0)
            gap_m = x_m[then, car - 1] - x_m[then, car] - LENGTH_M
            wanted_mps = top_mps[car] * (np.tanh(gap_m / 12.0 - 1.5) + np.tanh(1.5)) / (1.0 + np.tanh(1.5))
            a_mps2[car] += kappa[car] * (wanted_mps - v_mps[then, car])
            a_mps2[car] += lam[car] * (v_mps[then, car - 1] - v_mps[then, car])
        v_mps[k] = np.maximum(v_mps[k - 1] + dt * np.clip(a_mps2, -6.0, 3.0), 0.0)
        x_m[k] = x_m[k - 1] + 0.5 * dt * (v_mps[k] + v_mps[k - 1])
    t_s: F64 = dt * np.arange(n, dtype=np.float64)
    return Platoon("synthetic-platoon", t_s, x_m, v_mps, np.full(cars, LENGTH_M))
