"""Cost of one reading: our kernels from one pair to ten thousand, beside what a user would otherwise write.

`extra_info` of each holds how many readings a round judges, so that all can be told per reading.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from bench.ordinary import FilterpyPair, FilterpyTen, NumpyPairs, StoneSoupPair
from pytest_benchmark.fixture import BenchmarkFixture

from headway.core.estimation import registry
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

pytestmark = pytest.mark.bench
PAIRS = (1, 16, 100, 1_000, 10_000)
WARM_ROUNDS = 30
SPEED_MPS, GAP_M = 15.0, 30.0


class Road:
    """Pairs at a steady speed: what each reads in round k."""

    def __init__(self, pairs: int) -> None:
        self.pairs = pairs
        self.k = 0
        self._rng = np.random.default_rng(0)

    def next(self) -> tuple[Any, float]:
        """Return (n, 2) readings and where the leaders are."""
        self.k += 1
        x_m = SPEED_MPS * 0.1 * self.k
        z = np.array([x_m, SPEED_MPS]) + self._rng.normal(0.0, 0.01, (self.pairs, 2))
        return z, x_m + GAP_M


def measure(benchmark: BenchmarkFixture, pairs: int, step: Callable[..., Any], prepare: Callable[[], Any]) -> None:
    benchmark.extra_info["readings"] = pairs
    for _ in range(WARM_ROUNDS if pairs > 1 else 300):
        step(*prepare())
    benchmark.pedantic(step, setup=lambda: (prepare(), {}), rounds=300 if pairs < 10_000 else 50)


@pytest.mark.parametrize("pairs", PAIRS)
@pytest.mark.parametrize("name", ["headway", "ekf", "ca"])
def test_ours(benchmark: BenchmarkFixture, name: str, pairs: int) -> None:
    model = registry.build(DetectorConfig(model=name, vehicle_capacity=pairs, delay_s=0.0))
    road = Road(pairs)
    bank, rows, out = np.zeros(pairs, model.dtype), np.random.default_rng(1).permutation(pairs), verdicts(pairs)

    def prepare() -> tuple[Any, ...]:
        z, leader_x_m = road.next()
        read = readings(pairs)
        read["t_s"] = read["leader_t_s"] = 0.1 * road.k
        read["x_m"], read["v_mps"] = z.T
        read["leader_x_m"], read["leader_v_mps"], read["leader_length_m"] = leader_x_m, SPEED_MPS, 4.7
        return bank, rows, read, model.params, out

    measure(benchmark, pairs, model.step_batch, prepare)


@pytest.mark.parametrize("kind", [FilterpyPair, FilterpyTen, StoneSoupPair], ids=lambda kind: kind.__name__)
def test_a_hundred_objects(benchmark: BenchmarkFixture, kind: type) -> None:
    road = Road(100)
    pairs = [kind(0.0, SPEED_MPS) for _ in range(100)]

    def step(z: Any, leader: tuple[float, float]) -> None:
        for pair, reading in zip(pairs, z, strict=True):
            pair.step(reading, leader)

    def prepare() -> tuple[Any, ...]:
        z, leader_x_m = road.next()
        return z, (leader_x_m, SPEED_MPS)

    benchmark.extra_info["readings"] = 100
    benchmark.pedantic(step, setup=lambda: (prepare(), {}), rounds=20, warmup_rounds=2)


@pytest.mark.parametrize("pairs", [16, 1_000, 10_000])
def test_batched_numpy(benchmark: BenchmarkFixture, pairs: int) -> None:
    road = Road(pairs)
    together = NumpyPairs(np.zeros(pairs), np.full(pairs, SPEED_MPS))

    def prepare() -> tuple[Any, ...]:
        z, leader_x_m = road.next()
        return z, leader_x_m, np.full(pairs, SPEED_MPS)

    measure(benchmark, pairs, together.step, prepare)
