"""Cost of a message in a whole service, ours and a naive one: under the same load, and each near the most it holds."""

import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from pytest_benchmark.fixture import BenchmarkFixture
from sim.loopback import free_endpoint

from headway.child import running_service
from headway_loadtest.fleet_frames import FleetFrames
from headway_loadtest.run import Outcome, Plan, run
from headway_loadtest.session import SessionError, connect
from headway_schemas import Keys

pytestmark = pytest.mark.bench
WARMUP_S, SECONDS = 3.0, 8.0


@contextmanager
def ours(site: str) -> Iterator[str]:
    settings = {"site": site, "vehicle_capacity": 20_000}
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


def judged(endpoint: str, site: str, vehicles: int, bundle: int) -> Outcome:
    frames = FleetFrames(vehicles, WARMUP_S + SECONDS)
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
    site = "bench"
    with ours(site) if who == "ours" else naive(site, who) as endpoint:
        outcome = benchmark.pedantic(judged, (endpoint, site, vehicles, bundle), rounds=1)
    assert outcome.service is not None
    assert outcome.service.ledger.unaccounted == 0
    benchmark.extra_info["cpu_us"] = outcome.service.cpu_us
