"""`headway explain`: what was said of an event, beside what the same kernels say of it now."""

import json
from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import AsJson, ConfigFile, JournalFile, Site


def explain(
    event_id: Annotated[str, typer.Argument(help="As alerts carry it and `headway alerts list` shows it.")],
    journal: JournalFile = None,
    connect: Annotated[
        list[str] | None, typer.Option("--connect", help="zenoh endpoint of a service to ask instead of a file.")
    ] = None,
    site: Site = None,
    config: ConfigFile = None,
    plot: Annotated[Path | None, typer.Option(help="PNG or SVG file of readings, expectations and verdicts.")] = None,
    as_json: AsJson = False,
) -> None:
    """Judge the evidence of an event again and compare, number by number; exit 1 when one differs.

    Example: headway explain EVENT_ID --plot event.png
    """
    from rich.console import Console

    from headway.cli.run import alerts
    from headway.cli.run.bus import bus_access
    from headway.explain import compare as again

    if connect:
        bus = bus_access(config, connect)
        stored = alerts.on_bus(event_id, bus, site or bus.site)
    else:
        stored = alerts.in_journal(event_id, alerts.journal_file(journal, config))
    explained = [again.replayed(event) for event in stored]
    if plot is not None:
        from headway.explain.plot import draw

        draw(explained, plot)
    if as_json:
        typer.echo(json.dumps(again.to_json(explained)))
    else:
        again.show(explained, Console(highlight=False, soft_wrap=True))
    raise typer.Exit(0 if again.same(explained) else 1)
