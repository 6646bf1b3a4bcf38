"""`headway demo` and `headway loadtest`: a service of their own under replayed traffic."""

from typing import Annotated

import typer

from headway.cli.options import AsJson, ConfigFile


def demo(
    pairs: Annotated[int, typer.Option(min=1, max=2000, help="Pairs of cars.")] = 24,
    seconds: Annotated[float, typer.Option(min=10, max=3600, help="How long they drive.")] = 40.0,
    config: ConfigFile = None,
    as_json: AsJson = False,
) -> None:
    """Service and replay in one go, no router needed; ends with a report.

    Example: headway demo --pairs 50 --seconds 60
    """
    from headway.cli.run import demo as run

    run.demo(pairs=pairs, seconds=seconds, config=config, as_json=as_json)


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
    config: ConfigFile = None,
    as_json: AsJson = False,
) -> None:
    """Measure latency, loss and cost of a service in a process of its own; exit 1 when a target is missed.

    Example: headway loadtest --vehicles 5000 --seconds 30
    """
    from headway.cli.run import loadtest as run

    if find_limit:
        most = run.Load(vehicles, run.LIMIT_SECONDS, rate_hz, bundle)
        raise typer.Exit(run.find_limit(most, config=config, as_json=as_json))
    load = run.Load(vehicles, seconds, rate_hz, bundle, burst, rotate_s, surge)
    raise typer.Exit(run.loadtest(load, config=config, as_json=as_json))
