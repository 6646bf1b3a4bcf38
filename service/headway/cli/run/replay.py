"""Drives sent to a service that runs."""

from collections.abc import Sequence
from dataclasses import dataclass

from rich.console import Console

from headway.cli.run.bus import BusAccess, only
from headway.cli.run.progress import in_one_line, progress_bar
from headway.errors import UserError
from headway_loadtest import run as runs
from headway_loadtest.inject.spec import parse_spec
from headway_loadtest.measure.report import show
from headway_loadtest.sources import parse_sources, synthetic_vehicles
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.frames import SceneFrames, span_s
from headway_loadtest.traffic.session import connect
from headway_schemas.keys import Keys

SCENES_AT_ONCE = 500
"""Vehicles of recorded drives, and of a synthetic fleet beside them, that are under way together."""


@dataclass(frozen=True, slots=True)
class Request:
    """What is to be replayed and how."""

    sources: Sequence[str]
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
    vehicles = sum(map(synthetic_vehicles, request.sources))
    if len(request.sources) == 1 and vehicles and not (spec and any(kind.is_consistent for kind in spec.kinds)):
        return FleetFrames(vehicles, request.seconds, seed=request.seed, inject=spec), request.seconds
    if vehicles > SCENES_AT_ONCE:
        raise UserError(
            f"{' '.join(request.sources)}: beside another source, and with kinds that keep location and speed"
            f" consistent, at most {SCENES_AT_ONCE} synthetic vehicles drive at once"
        )
    scenes = parse_sources(request.sources, seconds=request.seconds, seed=request.seed)

    def frames() -> SceneFrames:
        return SceneFrames(scenes, seed=request.seed, inject=spec, seconds=request.seconds, concurrent=SCENES_AT_ONCE)

    length_s = span_s(frames())
    if not length_s:
        raise UserError(f"{' '.join(request.sources)}: nothing in it can be replayed")
    return frames(), length_s
