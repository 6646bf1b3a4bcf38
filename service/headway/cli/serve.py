"""`headway serve`: the service."""

import gc
from typing import Annotated

import typer

from headway.cli.options import ConfigFile


def serve(
    config: ConfigFile = None,
    standby: Annotated[
        bool, typer.Option("--standby", help="Load all kernels, then wait for HEADWAY_* as a line of JSON on stdin.")
    ] = False,
) -> None:
    """Judge the messages on the bus until SIGTERM or SIGINT.

    Example: HEADWAY_SITE=crossing headway serve --config headway.toml
    """
    gc.disable()  # nearly all that is imported stays; the loop collects while no message waits
    from headway.cli.run import serve as service
    from headway.settings import load

    if standby:
        service.stand_by(load(config).settings)
    service.serve(load(config))
