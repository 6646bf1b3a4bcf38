"""Services under the load of the load test: ours, a naive one, and the most that each holds.

The most is found with the generator on the same machine, and is its limit too: nothing lost, nothing unaccounted, and
nobody kept waiting. A naive service sheds nothing, so that one that cannot keep up holds up who sends to it.
"""

import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import NamedTuple

from sim.loopback import free_endpoint

from headway.cli.run.service_process import running_service
from headway_loadtest.measure.result import Outcome
from headway_loadtest.run import Plan, run
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.send import Put
from headway_loadtest.traffic.session import SessionError, connect
from headway_schemas import Keys

SITE = "bench"
TRIAL_SECONDS = 5.0
LATE_MS, LATENCY_MS = 100.0, 1_000.0
"""A generator that is held up by more than this, or a verdict that is later, one time in a hundred, shows a service
that does not keep up."""
FIRST_STEP = 1.5
"""Ratio of two loads, with which the search begins."""


class Running(NamedTuple):
    """A service that runs."""

    endpoint: str
    """Where its health is, on zenoh."""
    put: Put | None = None
    """How messages get there; None: on zenoh too."""


Start = Callable[[int], AbstractContextManager[Running]]
"""Starts a service for so many vehicles."""


@contextmanager
def ours(vehicles: int) -> Iterator[Running]:
    """Run headway."""
    settings = {"site": SITE, "vehicle_capacity": vehicles + vehicles // 5}
    with tempfile.TemporaryDirectory() as state, running_service(settings | {"state_dir": state}) as service:
        yield Running(service.endpoint)


def naive(kind: str) -> Start:
    """Return what runs the naive service with a class of `ordinary`."""

    @contextmanager
    def start(_vehicles: int) -> Iterator[Running]:
        endpoint = free_endpoint()
        process = subprocess.Popen([sys.executable, str(Path(__file__).parent / "naive.py"), endpoint, SITE, kind])
        try:
            yield Running(endpoint)
        finally:
            process.terminate()
            process.wait(10.0)

    return start


def measured_load(start: Start, vehicles: int, bundle: int, seconds: float, warmup_s: float = 3.0) -> Outcome:
    """Send from so many vehicles at 10 Hz, for some seconds after the warm-up."""
    frames = FleetFrames(vehicles, warmup_s + seconds)
    with start(vehicles) as service:
        for attempt in range(50):
            try:
                session = connect(service.endpoint)
            except SessionError:
                if attempt == 49:
                    raise
                continue
            break
        with session:
            return run(session, frames, Keys("v2x", SITE), Plan(warmup_s=warmup_s, bundle=bundle), put=service.put)


def holds(outcome: Outcome) -> bool:
    """Whether the service kept up."""
    service, late, latency = outcome.service, outcome.late, outcome.latency
    assert service is not None
    assert late is not None
    is_timely = late.p99 <= LATE_MS and (latency is None or latency.p99 <= LATENCY_MS)
    return service.ledger.unaccounted == 0 and not any(service.ledger.lost.values()) and is_timely


def most_held(start: Start, vehicles: int, bundle: int, *, within: float = 1.1, warmup_s: float = 3.0) -> Outcome:
    """Search from a first guess, up or down and then by halves of the ratio, for the most vehicles that are held."""
    held, too_many, best = 0, 0, None
    while not (held and too_many) or too_many > within * held:
        outcome = measured_load(start, vehicles, bundle, TRIAL_SECONDS, warmup_s)
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
