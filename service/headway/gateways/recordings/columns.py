"""Tables of records: CSV, Parquet and data frames, with columns named as the fields of BSM v1.

The leader is a column of maps `leader`, or the columns `leader.id`, `leader.range_m` and `leader.range_rate_mps`. The
column `v` may be left out. An empty cell is a value that the sender did not give.
"""

import csv
import difflib
import io
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, Final

from headway.gateways.recordings.csv_rows import CsvRows
from headway.gateways.recordings.parquet import opened_table
from headway.gateways.recordings.reader import CHUNK, Record, Row, Source
from headway_schemas.bsm import FIELDS, LEADER_FIELDS, NEEDED, WIRE_VERSION, Bsm

RECEIVED: Final = "received_us"
_LEADER_COLUMNS: Final = {f"leader.{name}": name for name in LEADER_FIELDS}
_KNOWN: Final = (*FIELDS, *_LEADER_COLUMNS, RECEIVED)
_TEXT: Final = ("id", "leader.id")
_INTEGERS: Final = frozenset(
    name for name, schema in Bsm.model_json_schema()["properties"].items() if schema.get("type") == "integer"
) | {RECEIVED}

Columns = Mapping[str, Sequence[Any]]


def require_columns(names: Iterable[str]) -> None:
    """Accept the names of a table's columns.

    Raises
    ------
    ValueError
        A column is unknown, twice there, or missing.
    """
    names = list(names)
    for name in names:
        if name not in _KNOWN:
            nearest = difflib.get_close_matches(name, _KNOWN, n=1)
            hint = f"did you mean {nearest[0]}?" if nearest else f"known are {', '.join(_KNOWN)}"
            raise ValueError(f"unknown column {name}: {hint}")
    if len(set(names)) < len(names):
        raise ValueError("a column twice")
    missing = [name for name in NEEDED if name not in names and name != "v"]
    if missing:
        raise ValueError(f"column {missing[0]} is missing: a record needs {', '.join(NEEDED[1:])}")


def columns_of(table: Any) -> Columns:
    """Return the columns of a table as lists, None for each missing value.

    `table` is a polars, pandas or Arrow table, or a mapping of sequences. NaN in a pandas or numpy column stands for
    a missing value.

    Raises
    ------
    TypeError
        It is none of these.
    ValueError
        The columns of a mapping differ in length.
    """
    package = type(table).__module__.partition(".")[0]
    if package == "polars":
        return {name: series.to_list() for name, series in table.to_dict().items()}
    if package == "pandas":
        return {str(name): _pandas_list(table[name]) for name in table.columns}
    if hasattr(table, "to_pydict"):
        columns: Columns = table.to_pydict()
        return columns
    if not isinstance(table, Mapping):
        raise TypeError(f"{type(table).__name__}: not a table, a mapping of columns or a list of records")
    columns = {str(name): _list(column) for name, column in table.items()}
    if len({len(column) for column in columns.values()}) > 1:
        raise ValueError("columns differ in length")
    return columns


def records_of(columns: Columns) -> list[Record]:
    """Return a record for each row.

    Raises
    ------
    ValueError
        As of `require_columns`.
    """
    require_columns(columns)
    lists = {
        name: [_whole(value) for value in column] if name in _INTEGERS else list(column)
        for name, column in columns.items()
    }
    count = len(next(iter(lists.values())))
    lists.setdefault("v", [WIRE_VERSION] * count)
    parts = {part: lists.pop(name) for name, part in _LEADER_COLUMNS.items() if name in lists}
    if parts:
        lists["leader"] = [_leader(parts, values) for values in zip(*parts.values(), strict=True)]
    elif "leader" in lists:
        lists["leader"] = [_leader(leader, leader.values()) if leader else None for leader in lists["leader"]]
    names = tuple(lists)
    return [dict(zip(names, values, strict=True)) for values in zip(*lists.values(), strict=True)]


def read_csv(source: Source) -> Iterator[list[Row]]:
    """Read a CSV file with a header, in UTF-8."""
    text = io.TextIOWrapper(source.stream, "utf-8-sig", newline="")
    lines = CsvRows(text, strict=True)
    try:
        header = [name.strip().lower() for name in next(lines, [])]
        _require(source, header)
        parsers = [_parser(name) for name in header]
        while cells := [(lines.line_num, row) for row in islice(lines, CHUNK) if row]:
            values = [_cells(source, number, header, parsers, row) for number, row in cells]
            records = records_of(dict(zip(header, zip(*values, strict=True), strict=True)))
            yield [Row(number, record) for (number, _), record in zip(cells, records, strict=True)]
    except csv.Error as error:
        raise source.error(error, lines.line_num) from None
    finally:
        text.detach()


def read_parquet(source: Source) -> Iterator[list[Row]]:
    """Read a Parquet file, some rows at a time."""
    assert source.path is not None
    with opened_table(source.path) as table:
        names = [column.name.lower() for column in table.columns]
        _require(source, names)
        for name, (_, kind, is_text) in zip(names, table.columns, strict=True):
            if name != "leader" and (name in _TEXT) is not is_text:
                raise source.error(f"column {name} is {kind}")
        source.share = table.share
        for first, values in table.batches():
            records = records_of(dict(zip(names, values, strict=True)))
            yield [Row(number, record) for number, record in enumerate(records, first + 1)]


def _require(source: Source, names: Iterable[str]) -> None:
    try:
        require_columns(names)
    except ValueError as error:
        raise source.error(f"{error}; a table of your own needs --columns") from None


def _cells(
    source: Source, number: int, header: list[str], parsers: list[Callable[[str], Any]], row: list[str]
) -> list[Any]:
    if len(row) != len(header):
        raise source.error(f"{len(row)} cells where the header has {len(header)}", number)
    try:
        return [parse(cell) for parse, cell in zip(parsers, row, strict=True)]
    except ValueError:
        for name, parse, cell in zip(header, parsers, row, strict=True):
            try:
                parse(cell)
            except ValueError:
                raise source.error(f"{name}: {cell!r} is not a number", number) from None
        raise


def _parser(name: str) -> Callable[[str], Any]:
    if name in _TEXT:
        return lambda cell: cell or None
    if name in _INTEGERS:
        return lambda cell: _whole_number(cell) if cell else None
    return lambda cell: float(cell) if cell else None


def _whole_number(cell: str) -> int | float:
    try:
        return int(cell)
    except ValueError:
        return float(cell)


def _leader(names: Iterable[str], values: Iterable[Any]) -> Record | None:
    leader = dict(zip(names, values, strict=True))
    return leader if any(value is not None for value in leader.values()) else None


def _whole(value: Any) -> Any:
    """Return the integer of a number that a table keeps as a float, as pandas does beside missing values."""
    return int(value) if type(value) is float and value.is_integer() else value


def _pandas_list(series: Any) -> list[Any]:
    values: list[Any] = series.astype(object).where(series.notna(), None).tolist()
    return values


def _list(column: Any) -> list[Any]:
    if not hasattr(column, "tolist"):
        return list(column)
    values = column.tolist()
    return [None if value != value else value for value in values]  # noqa: PLR0124 - NaN alone differs from itself
