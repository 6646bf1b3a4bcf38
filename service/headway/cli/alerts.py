"""`headway alerts`: the journal on the command line, with the service running or not."""

import csv
import json
import sqlite3
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import IO, Any, Final

import typer
from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from headway.edge.storage import journal_query
from headway.edge.storage.journal import reason_of
from headway.edge.storage.persistence import JOURNAL_FILE
from headway.errors import UserError
from headway.settings import load
from headway_schemas.event import Event
from headway_schemas.query import AlertsQuery

Writer = Callable[[Iterable[bytes], IO[bytes]], int]
"""Writes the JSON of statements in its own format; returns how many."""

_PARTS: Final = {"innovation": ("x_m", "v_mps"), "recovered": ("x_m", "v_mps", "x_std_m", "v_std_mps")}
_STAGES: Final = ("wire", "queue", "decode", "detect")


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
    with _told_in_one_line(file):
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


def export(file: Path, asked: AlertsQuery, write: Writer, out: Path | None) -> int:
    """Write every statement that meets the query, oldest first, `limit` aside; return how many."""
    with _told_in_one_line(file), _output(out) as to:
        return write((told.json for told in journal_query.read(file, asked, oldest_first=True)), to)


def write_lines(told: Iterable[bytes], to: IO[bytes]) -> int:
    """Write each as it went out, a line of JSON; return how many."""
    return sum(1 for line in told if to.write(line + b"\n"))


def write_csv(told: Iterable[bytes], to: IO[bytes]) -> int:
    """Write the flat columns of each, the evidence left out; return how many."""
    lines = csv.writer(_Encoder(to))
    count = 0
    for row in map(flat, told):
        if not count:
            lines.writerow(row)
        lines.writerow(row.values())
        count += 1
    return count


class _Encoder:
    """Text to bytes, for the csv module."""

    def __init__(self, to: IO[bytes]) -> None:
        self._to = to

    def write(self, text: str) -> int:
        return self._to.write(text.encode())


def flat(told: bytes) -> dict[str, Any]:
    """Return one row: every field but the evidence, the parts of a part under names of their own."""
    event: dict[str, Any] = json.loads(told)
    del event["evidence"]
    row: dict[str, Any] = {}
    for name, value in event.items():
        if name in _PARTS:
            row |= {f"{name}_{part}": (value or {}).get(part) for part in _PARTS[name]}
        elif name == "latency_us":
            row |= {f"latency_{stage}_us": value.get(stage) for stage in _STAGES}
        else:
            row[name] = value
    return row


def _time_us(text: str | None) -> int | None:
    if text is None:
        return None
    try:
        when = datetime.fromisoformat(text)
    except ValueError:
        raise UserError(f"{text}: no time; write it like 2024-05-01T12:00:00Z") from None
    return round((when if when.tzinfo else when.replace(tzinfo=UTC)).timestamp() * 1e6)


@contextmanager
def _output(out: Path | None) -> Iterator[IO[bytes]]:
    if out is None:
        yield sys.stdout.buffer
        return
    try:
        file = out.open("wb")
    except OSError as error:
        raise UserError(f"{out}: {error.strerror}") from None
    with file:
        yield file


@contextmanager
def _told_in_one_line(file: Path) -> Iterator[None]:
    try:
        yield
    except sqlite3.Error as error:
        raise UserError(f"{file}: no journal that can be read ({reason_of(error)}: {error})") from None
