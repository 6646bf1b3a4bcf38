"""One engine in a process of its own: what runs there, and its end in the service.

The process answers requests in order, over a pipe. It ends when the pipe does, so it never outlives the service.
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from headway.core.cells import PartStep
from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.core.types.sensor_quality import QualityStates
from headway.core.types.step_result import PairStates, RoundFailure, StepResult
from headway.core.types.vehicle_state import VehicleState
from headway.edge.clock import Clock
from headway.edge.identity import Identity
from headway.edge.storage.snapshots import Snapshots
from headway.edge.telemetry import logging_setup
from headway.edge.telemetry.process import rss_mb

_STARTS_S: Final = 300.0
"""The first start compiles the kernels."""
_HANGS_S: Final = 5.0
"""A process that takes longer to answer has ended, or hangs."""
ENDED: Final = "the process of an engine ended"


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineStart:
    """All that the process of an engine needs."""

    config: DetectorConfig
    identity: Identity
    clock: Clock
    snapshot_folder: Path | None
    """None: no snapshots."""
    snapshot_interval_s: float
    log_level: str
    log_format: str


@dataclass(frozen=True, slots=True, kw_only=True)
class EngineFigures:
    """What the process reports with each answer."""

    vehicles: int = 0
    pairs: int = 0
    active_events: int = 0
    cpu_s: float = 0.0
    rss_mb: float = 0.0
    newest_us: int = 0
    """This and the next three are of its snapshots, named as there."""
    written: int = 0
    failed: int = 0
    trouble: str | None = None


class EngineHost:
    """The engine and its snapshots, in their process; each public method answers the request of its name."""

    def __init__(self, start: EngineStart) -> None:
        self._clock = start.clock
        self._engine = engine = Engine(start.config)
        self._snapshots = None
        if start.snapshot_folder is not None:
            interval_s = start.snapshot_interval_s
            self._snapshots = Snapshots(start.snapshot_folder, interval_s, engine, start.identity, start.clock)
        engine.warm_up()

    def figures(self) -> EngineFigures:
        """Return what is reported with each answer."""
        engine, snapshots = self._engine, self._snapshots
        return EngineFigures(
            vehicles=engine.vehicles,
            pairs=engine.pairs,
            active_events=engine.active_events,
            cpu_s=time.process_time(),
            rss_mb=rss_mb() or 0.0,
            newest_us=snapshots.newest_us if snapshots is not None else 0,
            written=snapshots.written if snapshots is not None else 0,
            failed=snapshots.failed if snapshots is not None else 0,
            trouble=snapshots.trouble if snapshots is not None else None,
        )

    def tick(self) -> None:
        """Do the part of the snapshot that is due."""
        if self._snapshots is not None:
            self._snapshots.tick(self._clock.monotonic_ns())

    def load(self) -> list[str]:
        """Restore the vehicles of the snapshot; return their ids."""
        if self._snapshots is not None:
            self._snapshots.load()
        return self._engine.states().followers

    def states_of(self, vehicles: Sequence[str], released: Sequence[bool]) -> list[VehicleState | None]:
        """Return the states of vehicles; those `released` are of another engine from now on."""
        engine = self._engine
        of = zip(vehicles, released, strict=True)
        return [engine.release(vehicle) if goes else engine.state_of(vehicle) for vehicle, goes in of]

    def step(self, request: PartStep) -> StepResult:
        """Adopt vehicles, then step."""
        for state, owned in request.adopted:
            self._engine.adopt(state, owned=owned)
        return self._engine.step(request.batch, request.now_us, request.clock_offset_us, owned=request.owned)

    def pair_states(self, stride: int, phase: int) -> PairStates:
        """Return `Engine.states`."""
        return self._engine.states(stride, phase)

    def qualities(self, stride: int, phase: int) -> QualityStates | None:
        """Return `Engine.qualities`."""
        return self._engine.qualities(stride, phase)

    def open_event_ids(self) -> set[str]:
        """Return the ids of the open events."""
        return self._engine.open_event_ids

    def ignore_gaps_before(self, until_us: int) -> None:
        """Start no miss for a silence before then."""
        self._engine.ignore_gaps_before(until_us)

    def absent_until(self, until_us: int) -> None:
        """Let no vehicle be silent before then."""
        self._engine.absent_until(until_us)

    def close(self) -> None:
        """Take the last snapshot."""
        if self._snapshots is not None:
            self._snapshots.close()


def run_engine(connection: Connection, start: EngineStart) -> None:
    """Answer requests until the pipe ends; the main function of the process."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # the service ends it, after the last message
    logging_setup.configure(start.log_level, start.log_format)
    host = EngineHost(start)
    with suppress(EOFError, OSError):
        connection.send((None, host.figures()))
        while True:
            name, arguments = connection.recv()
            connection.send((getattr(host, name)(*arguments), host.figures()))
            host.tick()


class EngineProcess:
    """The service's end: sends requests and returns what waits for the answer, which is None once the process ended."""

    def __init__(self, start: EngineStart) -> None:
        self._start = start
        self.figures = EngineFigures()
        self.ended = False

    def start(self) -> None:
        """Start the process; `wait` until it is ready."""
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        self._process = context.Process(target=run_engine, args=(other, self._start), daemon=True)
        self._process.start()
        other.close()
        self.ended = False

    def wait(self) -> None:
        """Wait until the process is ready."""
        self._receive(_STARTS_S)

    def stop(self) -> None:
        """End the process at once."""
        self._connection.close()
        self._process.kill()
        self._process.join()

    def ask(self, name: str, *arguments: object) -> Callable[[], Any]:
        """Send a request; return what waits for the answer."""
        if not self.ended:
            try:
                self._connection.send((name, arguments))
            except OSError:
                self.ended = True
        return lambda: self._receive(_HANGS_S)

    def states(self, vehicles: Sequence[str], released: Sequence[bool]) -> Callable[[], list[VehicleState | None]]:
        """See `Part`."""
        wait = self.ask("states_of", vehicles, released)
        return lambda: wait() or [None] * len(vehicles)

    def step(self, request: PartStep) -> Callable[[], StepResult]:
        """See `Part`; the records of a process that ended have an outcome that says so."""
        wait = self.ask("step", request)

        def result() -> StepResult:
            stepped: StepResult | None = wait()
            if stepped is not None:
                return stepped
            outcomes = np.full(len(request.batch), Outcome.DETECTOR_FAILED, np.uint8)
            return StepResult(outcomes=outcomes, failures=[RoundFailure(ENDED, [])])

        return result

    def _receive(self, timeout_s: float) -> Any:  # noqa: ANN401 - the answer to any request
        if self.ended:
            return None
        try:
            if self._connection.poll(timeout_s):
                answer, self.figures = self._connection.recv()
                return answer
        except (EOFError, OSError):
            pass
        self.ended = True
        return None

    @property
    def pid(self) -> int:
        """Number of the process."""
        return self._process.pid or os.getpid()
