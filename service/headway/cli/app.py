"""The command line: registers the commands, each a file beside this one."""

import sys
from typing import Annotated, Final

import typer

from headway.cli import alerts, config, evaluate, fleet, gateway
from headway.cli.explain import explain
from headway.cli.judge import judge
from headway.cli.loadtest import demo, loadtest
from headway.cli.replay import replay
from headway.cli.serve import serve
from headway.cli.views import dashboard, watch
from headway.errors import UserError
from headway.version import version

app = typer.Typer(
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)

EXTRAS: Final = {
    "confluent_kafka": "kafka",
    "matplotlib": "plots",
    "paho": "mqtt",
    "polars": "recordings",
    "pyarrow": "recordings",
    "ray": "fleet",
    "starlette": "dashboard",
    "uvicorn": "dashboard",
    "zstandard": "recordings",
}
"""Packages that not every command needs, and the extra that brings each."""


def main() -> None:
    """Run the command line; end with one line and the status of the error when the user can mend it."""
    status = UserError.status
    try:
        app()
    except UserError as error:
        problem, status = str(error), error.status
    except ModuleNotFoundError as error:
        if error.name not in EXTRAS:
            raise
        problem = f"this needs {error.name}: pip install 'headway[{EXTRAS[error.name]}]'"
    else:
        return
    sys.stderr.write(f"headway: {problem}\n")
    sys.exit(status)


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
    """Find which reading, of which sensor, of which car, cannot be true.

    Example: headway demo
    """


for command in (serve, judge, demo, replay, loadtest, watch, dashboard, explain):
    app.command()(command)
app.add_typer(config.app, name="config")
app.add_typer(alerts.app, name="alerts")
app.add_typer(evaluate.app, name="evaluate")
app.add_typer(gateway.app, name="gateway")
app.add_typer(fleet.app, name="fleet")
