"""Rows of any table: CSV in the dialect that it has, or Parquet, and the numbers in their cells."""

import csv
import io
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from headway.gateways.recordings.csv_rows import CsvRows
from headway.gateways.recordings.parquet import opened_table
from headway.gateways.recordings.reader import PARQUET, Source

_NOT_GIVEN: Final = frozenset({"", "n/a", "na", "nan", "null", "none", "\\n", "-"})
_DELIMITERS: Final = ",;\t|"
_LINE_END: Final = re.compile(r"[\r\n]")
_NUMBER: Final = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?")
_DECIMAL_COMMA: Final = re.compile(r"[+-]?\d*,\d+([eE][+-]?\d+)?")
"""A number as spreadsheets of continental Europe write it, beside semicolons."""
_NOT_IN_ID: Final = re.compile(r"[^A-Za-z0-9_.-]")
_ID_MAX: Final = 64
CUT_ROW: Final = "another number of cells than the header has"


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row and its number, from 1 for the header; cells are text in CSV and any value in Parquet."""

    number: int
    cells: Sequence[Any]


def header_of(head: bytes) -> list[str]:
    """Return the names in the first line of a table that begins with these bytes."""
    line = _first_line(head)
    cells = csv.reader([line], delimiter=delimiter_of(line), skipinitialspace=True)
    return [name.strip() for name in next(cells, [])]


def _first_line(head: bytes) -> str:
    """Return the first line that is not blank; any of the three line ends closes it, as for the rows."""
    return _LINE_END.split(head.decode("utf-8-sig", "replace").lstrip("\r\n"), 1)[0]


def delimiter_of(line: str) -> str:
    """Return the delimiter that the line has most of, a comma where it has none."""
    return max(_DELIMITERS, key=line.count)


def table_rows(source: Source) -> Iterator[TableRow]:
    """Yield the rows of a table; the first is its first line, or the names of the columns of a Parquet file.

    A row of CSV that cannot be taken apart comes without cells.
    """
    if source.path is not None and source.stream.peek(4)[:4] == PARQUET:
        yield from _parquet_rows(source.path, source)
        return
    text = io.TextIOWrapper(source.stream, "utf-8-sig", errors="replace", newline="")
    try:
        delimiter = delimiter_of(_first_line(source.head))
        lines = CsvRows(text, delimiter=delimiter, skipinitialspace=True)
        while True:
            try:
                cells = next(lines)
            except StopIteration:
                return
            except csv.Error:
                cells = [""]
            if delimiter == ";":
                cells = [cell.replace(",", ".") if _DECIMAL_COMMA.fullmatch(cell) else cell for cell in cells]
            if cells:
                yield TableRow(lines.line_num, cells)
    finally:
        text.detach()


def _parquet_rows(path: Path, source: Source) -> Iterator[TableRow]:
    with opened_table(path) as table:
        yield TableRow(1, [column.name for column in table.columns])
        source.share = table.share
        for first, values in table.batches():
            yield from (TableRow(number, cells) for number, cells in enumerate(zip(*values, strict=True), first + 2))


def number(cell: Any) -> float | int | None:
    """Return the number in a cell, None where the cell says that there is none.

    Raises
    ------
    ValueError
        The cell holds something else.
    """
    if cell is None or isinstance(cell, int | float):
        return None if cell is None or cell != cell else cell  # noqa: PLR0124 - NaN
    text = str(cell).strip()
    if text.lower() in _NOT_GIVEN:
        return None
    if not _NUMBER.fullmatch(text):
        raise ValueError(text)
    return int(text) if text.lstrip("+-").isdecimal() else float(text)


def identifier(text: str) -> str:
    """Return an identifier of the bus: a character that it cannot have becomes `~` and its octets in hex.

    Two texts that differ stay apart, up to 64 characters of the result.
    """
    return _NOT_IN_ID.sub(lambda found: "".join(f"~{octet:02X}" for octet in found[0].encode()), text)[:_ID_MAX]
