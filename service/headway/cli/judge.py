"""`headway judge`: recordings through the service's own engine, at full speed, without a bus or a clock."""

from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import AsJson, Columns, ConfigFile, Format
from headway.errors import UserError


def judge(
    sources: Annotated[
        list[str], typer.Argument(help="Recordings of any format that docs/reference/recordings.md names; - is stdin.")
    ],
    form: Format = "auto",
    columns: Columns = None,
    config: ConfigFile = None,
    settings: Annotated[
        list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="A setting; may be repeated.")
    ] = None,
    events: Annotated[Path | None, typer.Option(help="File of event updates, JSON lines as on the wire.")] = None,
    verdicts: Annotated[
        Path | None, typer.Option(help="File with a row for each record: .csv, .jsonl or .parquet.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Judge recordings with the service's own engine, at full speed, without a bus.

    Example: headway judge drive.jsonl.gz --set alarm_budget_per_hour=0.5 --verdicts verdicts.csv
    """
    from headway.cli.run import judge as recordings
    from headway.cli.run.recorded.refusals import Reading
    from headway.settings import load

    loaded = load(config, dict(_assignment(text) for text in settings or ()))
    recordings.judge(
        Reading(sources, form, columns), loaded.settings, events=events, verdicts=verdicts, as_json=as_json
    )


def _assignment(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals:
        raise UserError(f"--set {text}: write it as KEY=VALUE")
    return name.strip(), value.strip()
