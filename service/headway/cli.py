"""The commands; wiring only. Each imports what it runs when it runs, so that the light ones start at once."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from headway.errors import UserError
from headway.version import version

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
config_app = typer.Typer(no_args_is_help=True, help="Settings: effective values, a check, their schema.")
app.add_typer(config_app, name="config")

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML file of settings; HEADWAY_* wins over it.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output and nothing else.")]


def main() -> None:
    """Run the command line; end with status 2 and one line when the user can mend it."""
    try:
        app()
    except UserError as error:
        sys.stderr.write(f"headway: {error}\n")
        sys.exit(2)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"headway {version()}")
        raise typer.Exit


@app.callback()
def root(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print it and exit.")
    ] = False,
) -> None:
    """Find which reading, of which sensor, of which car, cannot be true."""


@app.command()
def serve(config: ConfigFile = None) -> None:
    """Judge the messages on the bus until SIGTERM or SIGINT."""
    from headway import serve as service
    from headway.settings import load

    service.serve(load(config))


@config_app.command()
def show(config: ConfigFile = None, as_json: AsJson = False) -> None:
    """Print the effective settings and where each comes from."""
    from headway.settings import load

    loaded = load(config)
    values = loaded.settings.model_dump(mode="json")
    if as_json:
        typer.echo(json.dumps({name: {"value": v, "origin": loaded.origins[name]} for name, v in values.items()}))
        return
    width = max(map(len, values))
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {json.dumps(value):<24}  {loaded.origins[name]}")


@config_app.command()
def check(config: ConfigFile = None) -> None:
    """Say whether the service would start with these settings."""
    from headway.settings import Origin, load

    origins = list(load(config).origins.values())
    typer.echo("settings are right: " + ", ".join(f"{origins.count(o)} from {o}" for o in Origin))


@config_app.command()
def schema() -> None:
    """Print the JSON Schema of the settings."""
    from headway.settings import Settings

    typer.echo(json.dumps(Settings.model_json_schema(), indent=2))
