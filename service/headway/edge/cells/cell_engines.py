"""The engines of a site as one: what `Engine` is for the loop, with a process for each."""

import math
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from itertools import chain
from typing import Any, Final, TypeVar

import numpy as np
import structlog

from headway.core.cells import CellDispatch
from headway.core.tracking.cells import Lattice
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import Batch
from headway.core.types.sensor_quality import QualityStates, SensorQualities
from headway.core.types.step_result import PairStates, StepResult
from headway.edge.cells.engine_process import EngineFigures, EngineProcess, EngineStart
from headway.edge.telemetry.health import HealthState

_log: Final = structlog.get_logger(__name__)
_Columns = TypeVar("_Columns", PairStates, QualityStates, SensorQualities)


class CellEngines:
    """`Engine` for the loop, on several processes; one that ends is started again from its snapshot."""

    def __init__(self, starts: Sequence[EngineStart], lattice: Lattice, health: HealthState) -> None:
        self._processes = [EngineProcess(of) for of in starts]
        self._dispatch = CellDispatch(starts[0].config, lattice, self._processes)
        self._health = health
        self.restarts = 0
        """Processes that ended and were started again."""

    @property
    def handovers(self) -> int:
        """Vehicles that went from one engine to another."""
        return self._dispatch.handovers

    @property
    def figures(self) -> list[EngineFigures]:
        """What each process reported last; any thread may read it."""
        return [process.figures for process in self._processes]

    @property
    def vehicles(self) -> int:
        """Vehicles known now."""
        return sum(of.vehicles for of in self.figures)

    @property
    def pairs(self) -> int:
        """Vehicles that have a leader."""
        return sum(of.pairs for of in self.figures)

    @property
    def active_events(self) -> int:
        """Open events."""
        return sum(of.active_events for of in self.figures)

    @property
    def open_event_ids(self) -> set[str]:
        """The `event_id` of each open event."""
        return set().union(*self._all("open_event_ids"))

    def warm_up(self) -> None:
        """Start the processes; the first one alone, because it may have to compile the kernels."""
        for some in (self._processes[:1], self._processes[1:]):
            for process in some:
                process.start()
            for process in some:
                process.wait()
                if process.ended:
                    raise RuntimeError("the process of an engine did not start; its log says why")
        vehicles = VehicleTable(1)
        vehicles.evict(*vehicles.admit(["vehicle"]))

    def step(self, batch: Batch, now_us: int | None = None, clock_offset_us: int = 0) -> StepResult:
        """Do what `Engine.step` does; records of a process that ended are of the outcome `DETECTOR_FAILED`."""
        result = self._dispatch.step(batch, now_us, clock_offset_us)
        for k, process in enumerate(self._processes):
            if process.ended:
                self._restart(k)
        return result

    def ignore_gaps_before(self, until_us: int) -> None:
        """See `Engine`."""
        self._all("ignore_gaps_before", until_us)

    def absent_until(self, until_us: int) -> None:
        """See `Engine`."""
        self._all("absent_until", until_us)

    def states(self, stride: int = 1, phase: int = 0) -> PairStates:
        """See `Engine`."""
        states: PairStates = _joined(self._all("pair_states", stride, phase))
        return states

    def qualities(self, stride: int = 1, phase: int = 0) -> QualityStates | None:
        """See `Engine`."""
        qualities: list[QualityStates | None] = self._all("qualities", stride, phase)
        known = [of for of in qualities if of is not None]
        return _joined(known) if known else None

    def load(self) -> int:
        """Restore the vehicles of the snapshots; return how many."""
        for k, vehicles in enumerate(self._all("load")):
            self._dispatch.forget(k, vehicles)
        return self.vehicles

    def close(self) -> None:
        """Take the last snapshots, and end the processes."""
        self._all("close")
        for process in self._processes:
            process.stop()

    def _all(self, name: str, *arguments: object) -> list[Any]:
        answers = [wait() for wait in [process.ask(name, *arguments) for process in self._processes]]
        for k, process in enumerate(self._processes):
            if process.ended:
                self._restart(k)
                answers[k] = process.ask(name, *arguments)()
        return answers

    def _restart(self, k: int) -> None:
        """Start a process again from its snapshot; messages wait meanwhile."""
        self._health.problem = f"engine {k + 1} of {len(self._processes)} starts again"
        _log.error("the process of an engine ended; it starts again", engine=k)
        process = self._processes[k]
        process.stop()
        process.start()
        process.wait()
        vehicles = process.ask("load")()
        if process.ended:
            raise RuntimeError(f"engine {k} does not start again; its log says why")
        self._dispatch.forget(k, vehicles)
        self.restarts += 1
        self._health.problem = None
        _log.info("the engine continues", engine=k, vehicles=len(vehicles))


def _joined(parts: list[_Columns]) -> _Columns:
    """Return one value of columns from several of the same class."""
    columns: dict[str, Any] = {}
    for field in fields(parts[0]):
        of = [getattr(part, field.name) for part in parts]
        if isinstance(of[0], list):
            columns[field.name] = list(chain.from_iterable(of))
        else:
            columns[field.name] = _joined(of) if is_dataclass(of[0]) else np.concatenate(of)
    return type(parts[0])(**columns)


class EngineSnapshots:
    """`Snapshots` for the persistence: each process takes its own, in a folder of its own."""

    due_ns = math.inf
    """No part is due here."""

    def __init__(self, engines: CellEngines) -> None:
        self._engines = engines
        self.load = engines.load

    def tick(self, now_ns: int) -> None:
        """Do nothing."""

    def close(self, *, sync: bool) -> None:
        """Do nothing: `CellEngines.close` takes the last ones."""

    @property
    def newest_us(self) -> int:
        """Unix time of the newest message in the snapshots that were loaded; 0: none."""
        return max(of.newest_us for of in self._engines.figures)

    @property
    def written(self) -> int:
        """Whole snapshots of all engines."""
        return min(of.written for of in self._engines.figures)

    @property
    def failed(self) -> int:
        """Parts that could not be written."""
        return sum(of.failed for of in self._engines.figures)

    @property
    def trouble(self) -> str | None:
        """Why the newest one could not be written."""
        return next((of.trouble for of in self._engines.figures if of.trouble is not None), None)
