"""Drives sent to a service that runs."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console

from headway.cli.run.bus import BusAccess, only
from headway.cli.run.progress import in_one_line, progress_bar
from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.recorded.scenes import RecordedRows, is_recorded
from headway.errors import UserError
from headway.gateways.recordings.tables.cells import identifier
from headway_loadtest import run as runs
from headway_loadtest.inject.faults import Spec
from headway_loadtest.inject.spec import parse_spec
from headway_loadtest.measure.report import show
from headway_loadtest.sources import parse_sources, synthetic_vehicles
from headway_loadtest.sources.drive import Scene
from headway_loadtest.sources.records import RecordedDrives
from headway_loadtest.sources.sumo import PREFIX
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.frames import SceneFrames, span_s
from headway_loadtest.traffic.session import connect
from headway_loadtest.traffic.sumo_frames import SumoFrames
from headway_schemas.keys import Keys

SCENES_AT_ONCE = 500
"""Vehicles of recorded drives, and of a synthetic fleet beside them, that are under way together."""
DRIVES_APART_S: Final = 35.0
"""Pause between two recorded drives: a vehicle is evicted after 30 s of silence, so no two drives meet."""


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be replayed and how."""

    reading: Reading
    site: str
    speed: float
    inject: str | None
    seed: int
    seconds: float


def replay(request: Request, bus: BusAccess) -> None:
    """Replay sources to the service on `bus` and print what came of it.

    Raises
    ------
    UserError
        A source or the injection is wrong, or nothing answers on the bus.
    """
    endpoint = only(bus.endpoints)
    console = Console()
    with in_one_line():
        frames, length_s = frames_of(request)
        plan = runs.Plan(speed=request.speed, span_s=length_s)
        console.print(f"Connecting to {endpoint or bus.zenoh_config} ...", highlight=False)
        with (
            connect(endpoint, bus.zenoh_config) as session,
            progress_bar("replaying", length_s, console) as show_progress,
        ):
            outcome = runs.run(session, frames, Keys(bus.prefix, request.site), plan, on_progress=show_progress)
    show(outcome, console)


def frames_of(request: Request) -> tuple[runs.Frames, float]:
    """Return the frames of the sources, and how many seconds they last."""
    spec = parse_spec(request.inject) if request.inject is not None else None
    sources = request.reading.sources
    if any(word.startswith(PREFIX) for word in sources):
        return _simulated(request, spec), request.seconds
    if is_recorded(request.reading):
        return _lasting(request, RecordedDrives(RecordedRows(request.reading)), spec, DRIVES_APART_S)
    vehicles = sum(map(synthetic_vehicles, sources))
    if len(sources) == 1 and vehicles and not (spec and any(kind.is_consistent for kind in spec.kinds)):
        return FleetFrames(vehicles, request.seconds, seed=request.seed, inject=spec), request.seconds
    if vehicles > SCENES_AT_ONCE:
        raise UserError(
            f"{' '.join(sources)}: beside another source, and with kinds that keep location and speed"
            f" consistent, at most {SCENES_AT_ONCE} synthetic vehicles drive at once"
        )
    return _lasting(request, parse_sources(sources, seconds=request.seconds, seed=request.seed), spec, None)


def _simulated(request: Request, spec: Spec | None) -> SumoFrames:
    if len(request.reading.sources) > 1:
        raise UserError("a SUMO scenario is replayed by itself: leave the other sources out")
    config = Path(request.reading.sources[0].removeprefix(PREFIX))
    return SumoFrames(config, request.seconds, identifier, seed=request.seed, inject=spec)


def _lasting(
    request: Request, scenes: Iterable[Scene], spec: Spec | None, pause_s: float | None
) -> tuple[runs.Frames, float]:
    """Return the frames of scenes, and how many seconds they last."""

    def frames() -> SceneFrames:
        return SceneFrames(
            scenes,
            seed=request.seed,
            inject=spec,
            seconds=request.seconds,
            concurrent=SCENES_AT_ONCE,
            pause_s=pause_s,
        )

    length_s = span_s(frames())
    if not length_s:
        raise UserError(f"{' '.join(request.reading.sources)}: nothing in it can be replayed")
    return frames(), length_s
