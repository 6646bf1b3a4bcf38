"""`headway demo`: a service of its own and a replay, in one go."""

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
