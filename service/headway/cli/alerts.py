"""`headway alerts`: the journal of a service, whether it runs or not."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import AsJson, ConfigFile, From, JournalFile, OfKind, OfPhase, OfVehicle, To
from headway.errors import UserError

app = typer.Typer(no_args_is_help=True, help="The journal of a service: the events it detected.")


@app.command(name="list")
def list_alerts(
    journal: JournalFile = None,
    config: ConfigFile = None,
    from_time: From = None,
    to: To = None,
    kind: OfKind = None,
    phase: OfPhase = None,
    vehicle: OfVehicle = None,
    limit: Annotated[int, typer.Option(min=1, max=1000, help="The newest so many.")] = 20,
    updates: Annotated[bool, typer.Option("--updates", help="Every update of an event, a row each.")] = False,
    as_json: AsJson = False,
) -> None:
    """Print the newest events as they are known now, the last one last.

    With --phase or --updates a row is an update: what was published at that time.

    Example: headway alerts list --from -1h --phase onset
    """
    from headway.cli.run import alerts

    asked = alerts.query(
        from_time=from_time,
        to_time=to,
        kind=kind,
        phase=phase,
        vehicle=vehicle,
        limit=limit,
        newest=phase is None and not updates,
    )
    alerts.show(alerts.journal_file(journal, config), asked, as_json=as_json)


@app.command()
def export(
    out: Annotated[Path | None, typer.Argument(help="File to write; by default standard output.")] = None,
    journal: JournalFile = None,
    config: ConfigFile = None,
    from_time: From = None,
    to: To = None,
    kind: OfKind = None,
    phase: OfPhase = None,
    vehicle: OfVehicle = None,
    form: Annotated[
        str | None,
        typer.Option(
            "--format",
            help="jsonl with evidence; csv or parquet without; mr, mr-coer: ETSI reports. Else OUT's ending.",
        ),
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite OUT without a question.")] = False,
) -> None:
    """Write every event update, oldest first.

    Example: headway alerts export today.csv --from -24h
    """
    from headway.cli.run import alerts, alerts_export

    write = alerts_export.writer(form, out)
    asked = alerts.query(
        from_time=from_time,
        to_time=to,
        kind=kind,
        phase=phase,
        vehicle=vehicle,
        evidence=write is alerts_export.write_lines,
    )
    if out is not None and out.exists() and not force:
        _confirm_overwrite(out)
    count = alerts_export.export(alerts.journal_file(journal, config), asked, write, out)
    typer.echo(f"{count} event updates", err=True)


def interactive() -> bool:
    """Whether there is somebody to answer a question."""
    return sys.stdin.isatty()


def _confirm_overwrite(out: Path) -> None:
    if not interactive():
        raise UserError(f"{out} exists: --force overwrites it")
    typer.confirm(f"{out} exists. Overwrite it?", abort=True, err=True)
