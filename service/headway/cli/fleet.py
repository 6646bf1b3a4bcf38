"""`headway fleet`: many sites on the machines of a Ray cluster."""

from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import AsJson

app = typer.Typer(no_args_is_help=True, help="Many sites on the machines of a Ray cluster.")

Address = Annotated[str, typer.Option(help="Ray cluster, such as 10.0.0.1:6379; by default that of this machine.")]
WaitS = Annotated[float, typer.Option(min=0, help="Longest wait until it is done; exit 1 beyond.")]
_AUTO = "auto"


@app.command()
def up(
    config: Annotated[Path, typer.Option("--config", help="TOML file of the fleet: sites, settings, state_dir.")],
    discover_s: Annotated[
        float, typer.Option(min=0, help="Add the sites whose messages come within so many seconds.")
    ] = 0.0,
    replace: Annotated[
        bool, typer.Option("--replace", help="Replace each service, one by one, though nothing changed.")
    ] = False,
    address: Address = _AUTO,
    wait_s: WaitS = 600.0,
    as_json: AsJson = False,
) -> None:
    """Start a fleet, or bring it to another file: services whose settings or version differ are replaced one by one.

    Example: headway fleet up --config fleet.toml
    """
    from headway.cli.run import fleet as run

    raise typer.Exit(run.up(config, discover_s, run.Waiting(address, wait_s, as_json), replace=replace))


@app.command()
def status(address: Address = _AUTO, as_json: AsJson = False) -> None:
    """Show which node judges each site; exit 1 when a site is not judged.

    Example: headway fleet status --json
    """
    from headway.cli.run import fleet as run

    raise typer.Exit(run.status(run.Waiting(address, 0.0, as_json)))


@app.command()
def drain(
    node: Annotated[str, typer.Argument(help="Name as `status` shows it.")],
    address: Address = _AUTO,
    wait_s: WaitS = 600.0,
    as_json: AsJson = False,
) -> None:
    """Move each site from a node to others; none comes to it while it is up.

    Example: headway fleet drain node-2
    """
    from headway.cli.run import fleet as run

    raise typer.Exit(run.drain(node, run.Waiting(address, wait_s, as_json)))


@app.command()
def move(
    site: Annotated[str, typer.Argument(help="Name of the site.")],
    to: Annotated[str | None, typer.Option(help="Node; by default the one with most processors left.")] = None,
    address: Address = _AUTO,
    wait_s: WaitS = 600.0,
    as_json: AsJson = False,
) -> None:
    """Move a site to another node.

    Example: headway fleet move crossing-1 --to node-3
    """
    from headway.cli.run import fleet as run

    raise typer.Exit(run.move(site, to, run.Waiting(address, wait_s, as_json)))


@app.command()
def down(address: Address = _AUTO, wait_s: WaitS = 60.0) -> None:
    """Stop each service in order, then the controller; journals and snapshots stay.

    Example: headway fleet down
    """
    from headway.cli.run import fleet as run

    raise typer.Exit(run.down(run.Waiting(address, wait_s, as_json=False)))
