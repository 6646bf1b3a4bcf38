"""Every event update of a journal, written as lines, CSV or Parquet."""

import csv
import json
import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

from headway.cli.run.alerts import in_one_line
from headway.cli.run.misbehaviour.coer import write_coer
from headway.cli.run.misbehaviour.report import write_reports
from headway.cli.run.output_file import replaced
from headway.edge.storage import journal_query
from headway.errors import UserError
from headway_schemas.query import AlertsQuery

Writer = Callable[[Iterable[bytes], IO[bytes]], int]
"""Writes the JSON of event updates in its own format; returns how many."""

_PARTS: Final = {"innovation": ("x_m", "v_mps"), "recovered": ("x_m", "v_mps", "x_std_m", "v_std_mps")}
_STAGES: Final = ("wire", "queue", "decode", "detect")


def writer(form: str | None, out: Path | None) -> Writer:
    """Return what writes a format, by default that of the ending of `out`.

    Raises
    ------
    UserError
        No such format, or one that is no text for standard output.
    """
    chosen = form or ("jsonl" if out is None else out.suffix.lstrip("."))
    if chosen not in _WRITERS:
        wanted = f"--format {form}" if form else f"{out}"
        raise UserError(
            f"{wanted}: choose jsonl, csv or parquet, as the ending of the file or with --format, or mr, mr-coer"
        )
    if chosen == "parquet" and out is None:
        raise UserError("--format parquet is no text: name a file to write")
    return _WRITERS[chosen]


def export(file: Path, asked: AlertsQuery, write: Writer, out: Path | None) -> int:
    """Write every statement that meets the query, oldest first, `limit` aside; return how many."""
    with in_one_line(file), _output(out) as to:
        return write((stored.json for stored in journal_query.read(file, asked, oldest_first=True)), to)


def write_lines(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write each as it went out, a line of JSON; return how many."""
    return sum(1 for line in stored if to.write(line + b"\n"))


def write_csv(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write the flat columns of each, the evidence left out; return how many."""
    lines = csv.writer(_Encoder(to))
    count = 0
    for row in map(flat, stored):
        if not count:
            lines.writerow(row)
        lines.writerow(map(_cell, row.values()))
        count += 1
    return count


def _cell(value: object) -> object:
    """Return a cell that a spreadsheet takes for text where it is text: an id may begin as a formula does."""
    return f"'{value}" if isinstance(value, str) and value.startswith(("=", "+", "-", "@", "\t", "\r")) else value


class _Encoder:
    """Text to bytes, for the csv module."""

    def __init__(self, to: IO[bytes]) -> None:
        self._to = to

    def write(self, text: str) -> int:
        return self._to.write(text.encode())


def flat(stored: bytes) -> dict[str, Any]:
    """Return one row: every field but the evidence, the parts of a part under names of their own."""
    event: dict[str, Any] = json.loads(stored)
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


def write_parquet(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write the flat columns of each, the evidence left out; return how many."""
    import polars as pl

    table = pl.DataFrame([flat(one) for one in stored], infer_schema_length=None)
    table.write_parquet(to)
    return table.height


@contextmanager
def _output(out: Path | None) -> Iterator[IO[bytes]]:
    if out is None:
        yield sys.stdout.buffer
        return
    with replaced(out) as file:
        yield file


_WRITERS: Final[dict[str, Writer]] = {
    "jsonl": write_lines,
    "csv": write_csv,
    "parquet": write_parquet,
    "mr": write_reports,
    "mr-coer": write_coer,
}
