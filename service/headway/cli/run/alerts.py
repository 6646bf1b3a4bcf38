"""What a journal holds, read from its file or asked for on the bus."""

import json
import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from headway.client import BusFeed
from headway.edge.storage import journal_query
from headway.edge.storage.journal import reason_of
from headway.edge.storage.persistence import JOURNAL_FILE
from headway.errors import UserError
from headway.settings import load
from headway_schemas.event import Event
from headway_schemas.query import LIMIT_MAX, AlertsQuery

_CONNECT_S: Final = 5.0


def journal_file(journal: Path | None) -> Path:
    """Return the journal that is meant: the one named, or that of the service with the settings of here and now."""
    if journal is not None:
        return journal
    folder = load().settings.state_dir
    if folder is None:
        raise UserError("no journal: state_dir is empty; name one with --journal")
    return folder / JOURNAL_FILE


def query(**asked: Any) -> AlertsQuery:
    """Return a query of what was asked on the command line; times are ISO 8601 (UTC unless they say), or None."""
    times = {f"{name}_us": _time_us(asked.pop(f"{name}_time")) for name in ("from", "to")}
    try:
        return AlertsQuery.from_parameters({k: str(v) for k, v in {**asked, **times}.items() if v is not None})
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        raise UserError(f"--{first['loc'][0]} {first['input']}: {first['msg'].lower()}") from None


def statements(file: Path, asked: AlertsQuery) -> list[Event]:
    """Return the newest `limit` statements that meet a query, oldest first."""
    with in_one_line(file):
        return [Event.model_validate_json(told) for told in journal_query.page(file, asked)][::-1]


def show(file: Path, asked: AlertsQuery, *, as_json: bool) -> None:
    """Print the newest statements."""
    told = statements(file, asked)
    if as_json:
        typer.echo(json.dumps({"alerts": [event.model_dump(mode="json") for event in told]}))
        return
    table = Table("detected", "event", "phase", "kind", "sensor", "suspect", "statistic", "gate")
    for event in told:
        numbers = ("" if value is None else f"{value:.4g}" for value in (event.statistic, event.gate))
        when = datetime.fromtimestamp(event.detected_us / 1e6, UTC).isoformat(" ", "milliseconds")
        table.add_row(when, event.event_id, event.phase, event.kind, event.sensor, event.suspect, *numbers)
    Console().print(table)


def in_journal(event_id: str, journal: Path | None) -> list[Event]:
    """Return every update of an event in a journal file, oldest first.

    Raises
    ------
    UserError
        There is no such event, or no journal.
    """
    file = journal_file(journal)
    return _found(event_id, statements(file, _of_event(event_id)), str(file))


def on_bus(event_id: str, endpoint: str, site: str) -> list[Event]:
    """Return every update of an event in the journals of a site that answer on the bus, oldest first.

    Raises
    ------
    UserError
        There is no such event, or no journal answers.
    """
    asked = _of_event(event_id)
    feed = BusFeed([endpoint], [site])
    feed.start()
    try:
        give_up_s = time.monotonic() + _CONNECT_S
        while not feed.connection.connected and time.monotonic() < give_up_s:
            time.sleep(0.05)
        found = feed.history([site], asked)
    finally:
        feed.close()
    if not found.answers:
        said = f" ({found.problems[0]})" if found.problems else ""
        raise UserError(
            f"{endpoint}: no journal of site {site} answers{said}; see --site, and state_dir of the service"
        )
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
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise UserError(f"{text}: no time; write it like 2024-05-01T12:00:00Z") from None
    return round((when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp() * 1e6)


@contextmanager
def in_one_line(file: Path) -> Iterator[None]:
    """Turn what SQLite says of a journal into an error of the user."""
    try:
        yield
    except sqlite3.Error as error:
        raise UserError(f"{file}: no journal that can be read ({reason_of(error)}: {error})") from None
