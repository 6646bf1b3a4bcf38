"""`headway serve`: the service."""

import gc

from headway.cli.options import ConfigFile


def serve(config: ConfigFile = None) -> None:
    """Judge the messages on the bus until SIGTERM or SIGINT.

    Example: HEADWAY_SITE=crossing headway serve --config headway.toml
    """
    gc.disable()  # nearly all that is imported stays; the loop collects while no message waits
    from headway.cli.run import serve as service
    from headway.settings import load

    service.serve(load(config))
