"""A road of several lanes with cars that follow each other; some feign a brake, and one sensor is at fault."""

import numpy as np
from core.traffic import LAT_DEG, METRES_PER_DEGREE, START_US, STEP_US

from headway.core.types.batch import F64, Batch
from headway.core.types.identifiers import id_column

_LANE_DEG = 3.6 / 82_500.0  # of longitude at 42 degrees north


def _drive(cars: int, lanes: int, steps: int, rng: np.random.Generator) -> tuple[F64, F64]:
    """Return positions (steps, cars) and speeds of drivers by the IDM; car i + lanes follows car i."""
    x = -40.0 * (np.arange(cars) // lanes) + rng.uniform(-4.0, 4.0, cars)
    v, headway_s = np.full(cars, 14.0), rng.uniform(0.9, 1.5, cars)
    xs, vs, wish = np.empty((steps, cars)), np.empty((steps, cars)), np.full(cars, 20.0)
    for k in range(steps):
        xs[k], vs[k] = x, v
        for lane in range(lanes):
            wish[lane] = 14.0 + 4.0 * np.sin(0.021 * k + 2.0 * lane) + 1.5 * np.sin(0.057 * k + lane)
        free = 1.0 - (v / wish) ** 4
        gap, closing = x[:-lanes] - x[lanes:] - 4.5, v[lanes:] - v[:-lanes]
        wanted = 2.0 + v[lanes:] * headway_s[lanes:] + 0.5 * v[lanes:] * closing / np.sqrt(1.5 * 2.0)
        accel = 1.5 * free
        accel[lanes:] -= 1.5 * (np.maximum(wanted, 2.0) / np.maximum(gap, 0.5)) ** 2
        v = np.maximum(v + 0.1 * np.clip(accel, -6.0, 2.5), 0.0)
        x = x + 0.1 * v
    return xs, vs


def dense_road(cars: int = 400, lanes: int = 4, seconds: float = 120.0, seed: int = 1) -> list[Batch]:
    """Return a batch for each tenth of a second; the road goes north, and the first cars start 4 km from its begin.

    Cars with a number of 3 modulo 10 feign a brake of 6 m/s twice, consistent in position and speed.
    """
    rng, steps = np.random.default_rng(seed), round(seconds * 10)
    x, v = _drive(cars, lanes, steps, rng)
    x += 4000.0
    t_s, feigned = 0.1 * np.arange(steps), np.zeros((steps, cars))
    for car in range(3, cars, 10):
        for start_s in rng.uniform(60.0, max(seconds - 15.0, 61.0), 2):
            into = (t_s - start_s) / 6.0
            feigned[:, car] -= np.where((into > 0) & (into < 1), 6.0 * np.sin(np.pi * np.clip(into, 0, 1)) ** 2, 0.0)
    v = v + feigned
    x = x + 0.1 * np.cumsum(feigned, axis=0)
    x += rng.normal(0.0, 0.05, x.shape)
    v = np.maximum(v + rng.normal(0.0, 0.05, v.shape), 0.0)
    if cars > 50:
        x[round(0.7 * steps) : round(0.7 * steps) + 30, 50] += 8.0
    phase_us = np.sort(rng.integers(0, STEP_US, cars))
    order = rng.permutation(cars)
    ids, lane, unknown = id_column([f"car{i}" for i in order]), (order % lanes), np.full(cars, np.nan)
    return [
        Batch(
            ids=ids,
            leader_ids=id_column([None] * cars),
            msg_cnt=np.full(cars, k % 128),
            t_us=START_US + k * STEP_US + phase_us,
            received_us=START_US + k * STEP_US + phase_us + 5_000,
            lat_deg=LAT_DEG + x[k, order] / METRES_PER_DEGREE,
            lon_deg=-83.0 + lane * _LANE_DEG,
            speed_mps=v[k, order],
            heading_deg=np.zeros(cars),
            accel_mps2=unknown,
            accuracy_m=unknown,
            length_m=np.full(cars, 4.5),
            range_m=unknown,
            range_rate_mps=unknown,
        )
        for k in range(steps)
    ]
