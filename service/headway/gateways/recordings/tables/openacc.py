"""OpenACC: a platoon in one table, a few lines about it first, then columns numbered by the place of each car."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, date, datetime
from itertools import chain
from typing import Any, Final

from headway.gateways.recordings.order import in_time_order
from headway.gateways.recordings.reader import START_US, Row, Source
from headway.gateways.recordings.tables.cells import TableRow, number, table_rows
from headway.gateways.recordings.tables.mapping import TableReader, parse_mapping

_SPEED: Final = re.compile(r"Speed(\d{1,3})")
_PREAMBLE_MAX: Final = 20
_RADIANS_MAX: Final = math.pi / 2
"""Some campaigns give degrees: a latitude beyond this is no angle in radians."""


def recognise(head: bytes) -> bool:
    """Whether these first bytes are such a table."""
    return b"Speed1" in head and b"Lat1" in head and b"Time" in head


def read(source: Source) -> Iterator[Row]:
    """Yield a record for each car of each row, in the order of time; raises `RecordingError`."""
    rows = table_rows(source)
    about: dict[str, Sequence[Any]] = {}
    for row in rows:
        names = [str(cell).strip() for cell in row.cells]
        if "Time" in names:
            return in_time_order(_records(source, names, about, rows))
        about[names[0]] = names[1:]
        if row.number > _PREAMBLE_MAX:
            break
    raise source.error("no line with the columns Time, Speed1, Lat1 and Lon1")


def _records(
    source: Source, names: list[str], about: Mapping[str, Sequence[Any]], rows: Iterator[TableRow]
) -> Iterator[Row]:
    first = next(rows, None)
    if first is None:
        return
    cars = [
        int(found[1])
        for name in names
        if (found := _SPEED.fullmatch(name)) and {f"Lat{found[1]}", f"Lon{found[1]}"} <= set(names)
    ]
    unit = "rad" if all(_is_radians(first, names.index(f"Lat{car}")) for car in cars) else "deg"
    readers = [
        TableReader(
            parse_mapping(f"id=car,t=Time,lat=Lat{car}[{unit}],lon=Lon{car}[{unit}],speed=Speed{car}"),
            [*names, "car"],
            source.name,
            _start_us(about),
        )
        for car in cars
    ]
    order = about.get("Vehicle_order", ())
    ids = [f"{car}-{order[car - 1]}" if car <= len(order) else f"{car}" for car in cars]
    for row in chain([first], rows):
        for reader, vehicle in zip(readers, ids, strict=True):
            cells = row.cells if len(row.cells) < len(names) else [*row.cells[: len(names)], vehicle]
            yield reader.row(TableRow(row.number, cells))


def _is_radians(row: TableRow, place: int) -> bool:
    try:
        lat = number(row.cells[place])
    except (ValueError, IndexError):
        return True
    return lat is None or abs(lat) <= _RADIANS_MAX


def _start_us(about: Mapping[str, Sequence[Any]]) -> int:
    try:
        day = date.fromisoformat(about["Date"][0])
    except (KeyError, IndexError, ValueError):
        return START_US
    return int(datetime(day.year, day.month, day.day, tzinfo=UTC).timestamp()) * 1_000_000
