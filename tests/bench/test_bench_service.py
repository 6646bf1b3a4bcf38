"""A whole service, ours and a naive one: the cost of a message under the same load, and the most that each holds.

The most is found with the generator on the same machine, and is its limit too: nothing lost, nothing unaccounted, and
nobody kept waiting. A naive service sheds nothing, so that one that cannot keep up holds up who sends to it.
"""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from sim.loopback import free_endpoint

from headway.cli.run.service_process import running_service
from headway_loadtest.measure.result import Outcome
from headway_loadtest.run import Plan, run
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.session import SessionError, connect
from headway_schemas import Keys

pytestmark = pytest.mark.bench
WARMUP_S, SECONDS, TRIAL_SECONDS = 3.0, 8.0, 5.0
LATE_MS = 100.0
"""A generator that is held up by more than this, one time in a hundred, shows a service that does not keep up."""
FIRST_STEP, LAST_STEP = 1.5, 1.1
"""Ratios of two loads: the search begins with the one and ends within the other."""


@contextmanager
def ours(site: str, vehicles: int) -> Iterator[str]:
    settings = {"site": site, "vehicle_capacity": vehicles + vehicles // 5}
    with tempfile.TemporaryDirectory() as state, running_service(settings | {"state_dir": state}) as service:
        yield service.endpoint


@contextmanager
def naive(site: str, kind: str) -> Iterator[str]:
    endpoint = free_endpoint()
    process = subprocess.Popen([sys.executable, str(Path(__file__).parent / "naive.py"), endpoint, site, kind])
    try:
        yield endpoint
    finally:
        process.terminate()
        process.wait(10.0)


def measured_load(who: str, vehicles: int, bundle: int, seconds: float) -> Outcome:
    site, frames = "bench", FleetFrames(vehicles, WARMUP_S + seconds)
    with ours(site, vehicles) if who == "ours" else naive(site, who) as endpoint:
        for attempt in range(50):
            try:
                session = connect(endpoint)
            except SessionError:
                if attempt == 49:
                    raise
                continue
            break
        with session:
            return run(session, frames, Keys("v2x", site), Plan(warmup_s=WARMUP_S, bundle=bundle))


def holds(outcome: Outcome) -> bool:
    service, late = outcome.service, outcome.late
    assert service is not None
    assert late is not None
    return service.ledger.unaccounted == 0 and not any(service.ledger.lost.values()) and late.p99 <= LATE_MS


def most_held(who: str, vehicles: int, bundle: int) -> Outcome:
    """Search from a first guess, up or down and then by halves of the ratio, for the most vehicles that are held."""
    held, too_many, best = 0, 0, None
    while not (held and too_many) or too_many > LAST_STEP * held:
        outcome = measured_load(who, vehicles, bundle, TRIAL_SECONDS)
        if holds(outcome):
            held, best = vehicles, outcome
        else:
            too_many = vehicles
        if held and too_many:
            vehicles = round((held * too_many) ** 0.5)
        else:
            vehicles = round(held * FIRST_STEP or too_many / FIRST_STEP)
    assert best is not None
    return best


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
    outcome = benchmark.pedantic(measured_load, (who, vehicles, bundle, SECONDS), rounds=1)
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
    outcome = benchmark.pedantic(most_held, (who, guess, bundle), rounds=1)
    assert outcome.service is not None
    benchmark.extra_info["held"] = {"vehicles": outcome.vehicles, "bundle": bundle, "cpu_us": outcome.service.cpu_us}
