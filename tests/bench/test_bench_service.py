"""A whole service, ours and a naive one: the cost of a message under the same load, and the most that each holds."""

import pytest
from bench.services import Start, measured_load, most_held, naive, ours
from pytest_benchmark.fixture import BenchmarkFixture

pytestmark = pytest.mark.bench
SECONDS = 8.0


def service(who: str) -> Start:
    return ours if who == "ours" else naive(who)


@pytest.mark.parametrize(
    ("who", "vehicles", "bundle"),
    [
        ("ours", 1_000, 1),
        ("FilterpyPair", 1_000, 1),
        ("ours", 8_000, 1),
        ("FilterpyPair", 2_000, 1),
        ("ours", 15_000, 25),
        ("FilterpyPair", 2_500, 25),
        ("FilterpyTen", 70, 1),
    ],
)
def test_a_service(benchmark: BenchmarkFixture, who: str, vehicles: int, bundle: int) -> None:
    outcome = benchmark.pedantic(measured_load, (service(who), vehicles, bundle, SECONDS), rounds=1)
    assert outcome.service is not None
    assert outcome.service.ledger.unaccounted == 0
    benchmark.extra_info["cpu_us"] = outcome.service.cpu_us


@pytest.mark.parametrize(
    ("who", "guess", "bundle"),
    [
        ("ours", 12_000, 1),
        ("FilterpyPair", 3_500, 1),
        ("FilterpyTen", 260, 1),
        ("ours", 29_000, 25),
        ("FilterpyPair", 4_500, 25),
        ("FilterpyTen", 260, 25),
    ],
)
def test_the_most_a_service_holds(benchmark: BenchmarkFixture, who: str, guess: int, bundle: int) -> None:
    outcome = benchmark.pedantic(most_held, (service(who), guess, bundle), rounds=1)
    assert outcome.service is not None
    benchmark.extra_info["held"] = {"vehicles": outcome.vehicles, "bundle": bundle, "cpu_us": outcome.service.cpu_us}
