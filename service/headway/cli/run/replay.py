"""Drives sent to a service that runs."""

from collections.abc import Sequence

from rich.console import Console

from headway.cli.run.progress import in_one_line, progress_bar
from headway.errors import UserError
from headway_loadtest import run as runs
from headway_loadtest.inject.spec import parse_spec
from headway_loadtest.measure.report import show
from headway_loadtest.sources import parse_sources
from headway_loadtest.traffic.frames import SceneFrames, span_s
from headway_loadtest.traffic.session import connect
from headway_schemas.keys import Keys


def replay(
    sources: Sequence[str], *, site: str, speed: float, inject: str | None, seed: int, endpoint: str, seconds: float
) -> None:
    """Replay sources to the service at `endpoint` and tell what came of it."""
    with in_one_line():
        spec = parse_spec(inject) if inject is not None else None
        source = parse_sources(sources, seconds=seconds, seed=seed)

        def frames() -> SceneFrames:
            return SceneFrames(source, seed=seed, inject=spec, seconds=seconds)

        length_s = span_s(frames())
        if not length_s:
            raise UserError(f"{' '.join(sources)}: nothing in it can be replayed")
        plan = runs.Plan(speed=speed, span_s=length_s)
        with connect(endpoint) as session, progress_bar("replaying", length_s, Console()) as show_progress:
            outcome = runs.run(session, frames(), Keys("v2x", site), plan, on_progress=show_progress)
    show(outcome, Console())
