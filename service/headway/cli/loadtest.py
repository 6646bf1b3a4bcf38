"""`headway loadtest`: latency, loss and cost of a service under load."""

from typing import Annotated

import typer

from headway.cli.options import AsJson


def loadtest(
    vehicles: Annotated[
        int, typer.Option(min=1, help="Synthetic vehicles; with --find-limit, the most to try.")
    ] = 1000,
    seconds: Annotated[float, typer.Option(min=5, help="How long to measure, after 5 s of warm-up.")] = 30.0,
    rate_hz: Annotated[float, typer.Option(min=1, max=10, help="Messages of each vehicle per second.")] = 10.0,
    bundle: Annotated[int, typer.Option(min=1, max=512, help="Records per payload.")] = 1,
    burst: Annotated[bool, typer.Option(help="Everybody sends at the same instant.")] = False,
    rotate_s: Annotated[float, typer.Option(min=1, help="Each vehicle takes a new id this often.")] = float("inf"),
    surge: Annotated[
        int, typer.Option(min=0, help="So many vehicles more for those seconds, then the usual ones again.")
    ] = 0,
    find_limit: Annotated[bool, typer.Option(help="Find the most vehicles that meet the targets.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure latency, loss and cost of a service in a process of its own; exit 1 when a target is missed."""
    from headway.cli.run import loadtest as run

    if find_limit:
        raise typer.Exit(run.find_limit(vehicles_max=vehicles, rate_hz=rate_hz, bundle=bundle, as_json=as_json))
    missed = run.loadtest(
        vehicles=vehicles,
        seconds=seconds,
        rate_hz=rate_hz,
        bundle=bundle,
        burst=burst,
        rotate_s=rotate_s,
        surge=surge,
        as_json=as_json,
    )
    raise typer.Exit(missed)
