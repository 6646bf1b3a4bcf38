"""What a journal holds, read from its file or asked for on the bus."""

import json
import re
import sqlite3
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import ValidationError
from rich.console import Console

from headway import client
from headway.cli.run.bus import BusAccess
from headway.dashboard.terminal.fitted_table import FittedTable
from headway.edge.storage import handling_store, journal_query
from headway.edge.storage.journal_format import reason_of
from headway.edge.storage.persistence import JOURNAL_FILE
from headway.errors import UserError
from headway.settings import load
from headway_schemas.event import Event, Phase
from headway_schemas.handling import Action, Handling
from headway_schemas.query import LIMIT_MAX, AlertsQuery

_AGO: Final = re.compile(r"-(?P<count>\d+(\.\d+)?)(?P<unit>[smhd])")
_DONE: Final = {Action.ACKNOWLEDGE: "acknowledged", Action.MUTE: "muted", Action.RESOLVE: "resolved"}
_SECONDS: Final = {"s": 1, "m": 60, "h": 3_600, "d": 86_400}


def journal_file(journal: Path | None, config: Path | None = None) -> Path:
    """Return the journal that is meant: the one named, or that of the service with these settings."""
    if journal is not None:
        return journal
    folder = load(config).settings.state_dir
    if folder is None:
        raise UserError("no journal: state_dir is empty; name one with --journal")
    return folder / JOURNAL_FILE


def query(**asked: Any) -> AlertsQuery:
    """Return a query of what was asked on the command line; times are ISO 8601 (UTC unless they say), ago, or None."""
    times = {f"{name}_us": _time_us(asked.pop(f"{name}_time")) for name in ("from", "to")}
    try:
        return AlertsQuery.from_parameters({k: str(v) for k, v in {**asked, **times}.items() if v is not None})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise UserError(f"--{first['loc'][0]} {first['input']}: {first['msg'].lower()}") from None


def stored_events(file: Path, asked: AlertsQuery) -> list[Event]:
    """Return the newest `limit` event updates that meet a query, oldest first."""
    with in_one_line(file):
        return [Event.model_validate_json(stored) for stored in journal_query.page(file, asked)][::-1]


def show(file: Path, asked: AlertsQuery, *, as_json: bool) -> None:
    """Print the events or updates that meet a query."""
    events = stored_events(file, asked)
    with in_one_line(file):
        handlings = handling_store.newest(file)
    if as_json:
        alerts, handled = ([one.model_dump(mode="json") for one in ones] for ones in (events, handlings))
        typer.echo(json.dumps({"alerts": alerts, "handlings": handled}))
        return
    rows = [_row(event) | {"handling": _handling(event, handlings)} for event in events]
    if sys.stdout.isatty():
        print_table(rows, Console())
    else:
        for row in rows:
            typer.echo("\t".join(row.values()))


def _row(event: Event) -> dict[str, str]:
    """Return the columns, the most important first."""
    when = datetime.fromtimestamp(event.detected_us / 1e6, UTC)
    return {
        "event": event.event_id,
        "detected": when.isoformat("T", "milliseconds").replace("+00:00", "Z"),
        "phase": event.phase,
        "kind": event.kind,
        "sensor": event.sensor,
        "suspect": event.suspect,
        "statistic": "" if event.statistic is None else f"{event.statistic:.4g}",
        "gate": "" if event.gate is None else f"{event.gate:.4g}",
    }


def _handling(event: Event, handlings: list[Handling]) -> str:
    """Return what people decided about the suspect, and the newest note."""
    onset_us, is_open = event.onset_us or event.detected_us, event.phase is not Phase.CLEARED
    found = []
    for one in handlings:
        if (one.site, one.vehicle) != (event.site, event.suspect):
            continue
        if one.action is Action.NOTE:
            found.append(" ".join(f"{one.by}: {one.note}".split()))
        elif one.is_in_force(onset_us=onset_us, is_open=is_open, now_us=time.time_ns() // 1000):
            found.append(" ".join(f"{_DONE[one.action]} by {one.by}".split()))
    return "; ".join(found)


def print_table(rows: list[dict[str, str]], console: Console) -> None:
    """Print as many columns as are shown in full; an id is always one of them, if need be beyond the edge."""
    if not rows:
        console.print("no events")
        return
    names = list(rows[0])
    table = FittedTable(names, droppable=names[:0:-1], note=True)
    for row in rows:
        table.add_row(*row.values())
    console.width = max(console.width, *(len(row["event"]) for row in rows))
    console.print(table)


def in_journal(event_id: str, file: Path) -> list[Event]:
    """Return every update of an event in a journal file, oldest first.

    Raises
    ------
    UserError
        There is no such event, or no journal.
    """
    return _found(event_id, stored_events(file, _of_event(event_id)), str(file))


def on_bus(event_id: str, bus: BusAccess, site: str) -> list[Event]:
    """Return every update of an event in the journals of a site that answer on the bus, oldest first.

    Raises
    ------
    UserError
        There is no such event, or no journal answers.
    """
    asked = _of_event(event_id)
    found = client.history(asked, bus.endpoints, site=site, prefix=bus.prefix, zenoh_config=bus.zenoh_config)
    if not found.answers:
        said = f" ({found.problems[0]})" if found.problems else ""
        where = ", ".join(bus.endpoints) or bus.zenoh_config
        raise UserError(f"{where}: no journal of site {site} answers{said}; see --site, and state_dir of the service")
    return _found(event_id, found.events[::-1], f"the journals of site {site}")


def _of_event(event_id: str) -> AlertsQuery:
    try:
        return AlertsQuery(event=event_id, evidence=True, limit=LIMIT_MAX)
    except ValueError:
        raise UserError(f"{event_id!r} is no event id; `headway alerts list` shows them") from None


def _found(event_id: str, events: list[Event], where: str) -> list[Event]:
    if not events:
        raise UserError(f"{event_id}: no such event in {where}; `headway alerts list` shows what there is")
    return events


def _time_us(text: str | None) -> int | None:
    if text is None:
        return None
    if ago := _AGO.fullmatch(text):
        return time.time_ns() // 1000 - round(float(ago["count"]) * _SECONDS[ago["unit"]] * 1e6)
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise UserError(f"{text}: no time; write it like 2024-05-01T12:00:00Z, or -1h for an hour ago") from None
    return round((when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp() * 1e6)


@contextmanager
def in_one_line(file: Path) -> Iterator[None]:
    """Turn what SQLite says of a journal into an error of the user."""
    try:
        yield
    except sqlite3.Error as error:
        raise UserError(f"{file}: no journal that can be read ({reason_of(error)}: {error})") from None
