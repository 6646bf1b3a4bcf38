"""The options that several commands take, and a way to give a command its options as one value."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import wraps
from pathlib import Path
from typing import Annotated, Any

import typer

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML file of settings; HEADWAY_* wins over it.")]
Connect = Annotated[
    list[str] | None,
    typer.Option(
        "--connect",
        help="zenoh endpoint of a service or router; repeat it to see several. By default as set.",
    ),
]
ConnectOne = Annotated[
    list[str] | None,
    typer.Option("--connect", help="zenoh endpoint of the service or a router. By default as set."),
]
Site = Annotated[str | None, typer.Option(help="Site of the service. By default as set.")]
Sites = Annotated[list[str] | None, typer.Option("--site", help="Site to show; may be repeated. By default as set.")]
ZenohConfig = Annotated[Path | None, typer.Option(help="JSON5 file of zenoh's own options, such as certificates.")]
JournalFile = Annotated[
    Path | None, typer.Option("--journal", help="Journal of a service; by default that of state_dir.")
]
From = Annotated[
    str | None,
    typer.Option("--from", help="Detected then or later: ISO 8601 (UTC), or -90s, -15m, -1h, -7d ago."),
]
To = Annotated[str | None, typer.Option(help="Detected before; written likewise.")]
OfKind = Annotated[str | None, typer.Option("--kind", help="One kind, such as bias.")]
OfPhase = Annotated[str | None, typer.Option("--phase", help="onset, update or cleared; onset gives a line for each.")]
OfVehicle = Annotated[str | None, typer.Option("--vehicle", help="Suspect, follower or leader.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output and nothing else.")]
Format = Annotated[str, typer.Option("--format", help="auto, bsm, ode, bsmp1, fcd, ...: see the table of formats.")]
Columns = Annotated[
    str | None,
    typer.Option(
        "--columns", help="Mapping of a table of your own, such as id=car,t=time[ms],lat=y,lon=x,speed=v[mph]."
    ),
]


def options_as(group: type[Any]) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator: the parameter `options` of a command, a dataclass, becomes an option for each field."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        @wraps(command)
        def call(**given: object) -> None:
            command(options=group(**{field.name: given.pop(field.name) for field in fields(group)}), **given)

        parameters = []
        for own in inspect.signature(command).parameters.values():
            found = [(f.name, f.default, f.type) for f in fields(group)]
            for name, default, kind in found if own.name == "options" else [(own.name, own.default, own.annotation)]:
                parameters.append(inspect.Parameter(name, own.KEYWORD_ONLY, default=default, annotation=kind))
        call.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
        call.__annotations__ = {p.name: p.annotation for p in parameters}
        return call

    return decorate
