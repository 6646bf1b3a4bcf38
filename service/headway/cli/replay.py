"""`headway replay`: drives sent to a service that runs here or elsewhere."""

from typing import Annotated

import typer


def replay(
    sources: Annotated[list[str], typer.Argument(help="An SPMD folder, pair CSV files, or synthetic:N.")],
    site: Annotated[str, typer.Option(help="Site whose keys to use.")] = "local",
    speed: Annotated[float, typer.Option(min=0.01, help="Times real time; above 1 the service needs max_age_s.")] = 1.0,
    inject: Annotated[str | None, typer.Option(help="Anomalies, such as c=1,p=0.005,kinds=noise+bias+drift.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed replays the same.")] = 0,
    connect: Annotated[str, typer.Option(help="zenoh endpoint of the service or a router.")] = "tcp/127.0.0.1:7447",
    seconds: Annotated[float, typer.Option(min=1, help="Stop after so long; a synthetic fleet drives so long.")] = 600,
) -> None:
    """Replay drives to a running service, in real time or faster, with injected anomalies."""
    from headway.cli.run import replay as run

    run.replay(sources, site=site, speed=speed, inject=inject, seed=seed, endpoint=connect, seconds=seconds)
