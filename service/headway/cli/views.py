"""`headway watch` and `headway dashboard`: what the service tells, on a terminal and on a page."""

from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import Connect, Sites, ZenohConfig
from headway.errors import UserError

DEFAULT_SITES = ["local"]


def watch(
    connect: Connect = None,
    site: Sites = None,
    zenoh_config: ZenohConfig = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON objects, one a line.")] = False,
) -> None:
    """Show alerts, pairs and health in the terminal; plain lines where there is none."""
    from headway.dashboard import watch as view

    view.watch(
        connect=_endpoints(connect, zenoh_config),
        sites=site or DEFAULT_SITES,
        zenoh_config=zenoh_config,
        as_json=as_json,
    )


def dashboard(
    connect: Connect = None,
    site: Sites = None,
    zenoh_config: ZenohConfig = None,
    host: Annotated[str, typer.Option(help="Address of the page; beyond loopback a token is needed.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65_535, help="Port of the page; 0 takes a free one.")] = 8080,
    token_file: Annotated[Path | None, typer.Option(help="File with the token that opens the page.")] = None,
    name: Annotated[list[str] | None, typer.Option(help="Further host name of the page; may be repeated.")] = None,
) -> None:
    """Serve a web page of alerts, pairs and health."""
    try:
        from headway.dashboard import server
    except ModuleNotFoundError as error:
        raise UserError(f"the page needs {error.name}: pip install 'headway[dashboard]'") from None
    server.serve(
        connect=_endpoints(connect, zenoh_config),
        sites=site or DEFAULT_SITES,
        host=host,
        port=port,
        token_file=token_file,
        names=name or (),
        zenoh_config=zenoh_config,
    )


def _endpoints(connect: list[str] | None, zenoh_config: Path | None) -> list[str]:
    """Return what was asked for; else leave it to the file; else the service on this machine."""
    return connect or ([] if zenoh_config else ["tcp/127.0.0.1:7447"])
