"""`headway watch` and `headway dashboard`: what the service publishes, on a terminal and on a page."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from headway.cli.options import ConfigFile, Connect, Sites, ZenohConfig, options_as

if TYPE_CHECKING:
    from headway_schemas import Event


def watch(
    connect: Connect = None,
    site: Sites = None,
    config: ConfigFile = None,
    zenoh_config: ZenohConfig = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON objects, one a line.")] = False,
) -> None:
    """Show faulty vehicles, pairs and health in the terminal; plain lines where there is none.

    Keys: s sorts, v switches between vehicles and alerts, j and k scroll, q quits.

    Example: headway watch --connect tcp/10.0.0.1:7447 --site crossing
    """
    from headway.cli.run.bus import bus_access
    from headway.dashboard.terminal import watch as view

    bus = bus_access(config, connect, zenoh_config)
    view.watch(
        connect=bus.endpoints,
        sites=site or (bus.site,),
        prefix=bus.prefix,
        zenoh_config=bus.zenoh_config,
        as_json=as_json,
    )


@dataclass(frozen=True)
class NoticeOptions:
    """Where notices of faulty vehicles go."""

    webhook: Annotated[str | None, typer.Option(help="URL that gets a POST when a vehicle is faulty, and no more.")] = (
        None
    )
    alertmanager: Annotated[str | None, typer.Option(help="Alertmanager, such as http://127.0.0.1:9093.")] = None
    runbook_url: Annotated[str | None, typer.Option(help="What the notices name as the place of advice.")] = None


@options_as(NoticeOptions)
def dashboard(
    options: NoticeOptions,
    connect: Connect = None,
    site: Sites = None,
    config: ConfigFile = None,
    zenoh_config: ZenohConfig = None,
    host: Annotated[str, typer.Option(help="Address of the page; beyond loopback a token is needed.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65_535, help="Port of the page; 0 takes a free one.")] = 8080,
    token_file: Annotated[Path | None, typer.Option(help="File with the token that opens the page.")] = None,
    name: Annotated[list[str] | None, typer.Option(help="Further host name of the page; may be repeated.")] = None,
    basemap: Annotated[Path | None, typer.Option(help="PMTiles file that is drawn below the road.")] = None,
) -> None:
    """Serve a web page of alerts, pairs and health, and notify others of faulty vehicles.

    Example: headway dashboard --port 8081 --connect tcp/10.0.0.1:7447
    """
    from headway.cli.run.bus import bus_access
    from headway.dashboard import server
    from headway.dashboard.app import Features
    from headway.dashboard.basemap import Basemap
    from headway.dashboard.notifier import Receivers

    bus = bus_access(config, connect, zenoh_config)
    server.serve(
        connect=bus.endpoints,
        sites=site or (bus.site,),
        prefix=bus.prefix,
        host=host,
        port=port,
        token_file=token_file,
        names=name or (),
        zenoh_config=bus.zenoh_config,
        receivers=Receivers(options.webhook, options.alertmanager, options.runbook_url),
        features=Features(_explained, None if basemap is None else Basemap(basemap)),
    )


def _explained(updates: "Sequence[Event]") -> dict[str, Any]:
    """Compute the updates of an event again; the kernels are loaded at the first call."""
    from headway.explain import compare

    explained = [compare.replayed(update) for update in updates]
    return compare.to_json(explained) | {"estimates": compare.estimates(explained)}
