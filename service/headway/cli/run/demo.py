"""A service of its own and a replay to it: synthetic pairs with injected faults, and what was found of them."""

import json
from pathlib import Path

import typer
from rich.console import Console

from headway.cli.run.progress import in_one_line, progress_bar
from headway.cli.run.service_process import PREFIX, running_service
from headway_loadtest import run as runs
from headway_loadtest.inject.faults import ALGORITHM_1, Kind, Spec
from headway_loadtest.measure.report import Targets, show, to_json
from headway_loadtest.sources.synthetic import SyntheticPairs
from headway_loadtest.traffic.frames import SceneFrames
from headway_loadtest.traffic.session import connect
from headway_schemas.keys import Keys

DEMO_SEED = 1
DEMO_INJECTION = Spec(c=1.0, p=0.003, share=0.4, kinds=(*ALGORITHM_1, Kind.SHORT, Kind.MISS))


def demo(*, pairs: int, seconds: float, config: Path | None, as_json: bool) -> None:
    """Service and replay in one go: synthetic pairs with injected faults, and what was found of them."""
    console = Console(stderr=as_json)
    with in_one_line():
        frames = SceneFrames(SyntheticPairs(pairs, seconds, DEMO_SEED), seed=DEMO_SEED, inject=DEMO_INJECTION)
        console.print("Starting the service (its first start compiles the filters, which takes a minute).")
        with (
            running_service({"site": "demo"}, config) as service,
            connect(service.endpoint) as session,
            progress_bar("driving", seconds, console) as show_progress,
        ):
            outcome = runs.run(session, frames, Keys(PREFIX, "demo"), runs.Plan(), on_progress=show_progress)
    if as_json:
        typer.echo(json.dumps(to_json(outcome, Targets())))
    else:
        show(outcome, console)
