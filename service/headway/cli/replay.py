"""`headway replay`: drives sent to a service that runs here or elsewhere."""

from dataclasses import dataclass
from typing import Annotated

import typer

from headway.cli.options import Columns, ConfigFile, ConnectOne, Format, Site, ZenohConfig, options_as


@dataclass(frozen=True)
class ReplayOptions:
    """The options of `headway replay` that say how it is played."""

    speed: Annotated[float, typer.Option(min=0.01, help="Times real time; above 1 the service needs max_age_s.")] = 1.0
    inject: Annotated[str | None, typer.Option(help="Faults to inject, such as c=1,share=0.04.")] = None
    seed: Annotated[int, typer.Option(min=0, help="The same seed replays the same.")] = 0
    seconds: Annotated[float, typer.Option(min=1, help="Stop after so long; a synthetic fleet drives so long.")] = 600


@options_as(ReplayOptions)
def replay(
    sources: Annotated[
        list[str], typer.Argument(help="Recordings, an SPMD folder, pair CSVs, synthetic:N, or sumo:CONFIG.sumocfg.")
    ],
    options: ReplayOptions,
    form: Format = "auto",
    columns: Columns = None,
    site: Site = None,
    connect: ConnectOne = None,
    config: ConfigFile = None,
    zenoh_config: ZenohConfig = None,
) -> None:
    """Replay drives to a running service, in real time or faster, with injected anomalies.

    Example: headway replay synthetic:50 --inject c=1,share=0.04
    """
    from headway.cli.run import replay as run
    from headway.cli.run.bus import bus_access
    from headway.cli.run.recorded.refusals import Reading

    bus = bus_access(config, connect, zenoh_config)
    reading = Reading(sources, form, columns)
    request = run.Request(reading, site or bus.site, options.speed, options.inject, options.seed, options.seconds)
    run.replay(request, bus)
