"""JSON lines: one BSM v1 map in each."""

import json
from collections.abc import Iterator
from itertools import islice
from typing import Final

from headway.gateways.recordings.reader import BOM, CHUNK, Row, Source

_LINE_BYTES_MAX: Final = 65_536

_Line = tuple[int, bytes]


def read_lines(source: Source) -> Iterator[list[Row]]:
    """Read a map from each line; blank lines are left out."""
    lines = _lines(source)
    while chunk := list(islice(lines, CHUNK)):
        yield _rows(source, chunk)


def _lines(source: Source) -> Iterator[_Line]:
    number = 0
    while line := source.stream.readline(_LINE_BYTES_MAX + 1):
        number += 1
        if len(line) > _LINE_BYTES_MAX:
            raise source.error(f"longer than {_LINE_BYTES_MAX} bytes", number)
        if line := (line.removeprefix(BOM) if number == 1 else line).strip():
            yield number, line


def _rows(source: Source, lines: list[_Line]) -> list[Row]:
    """Parse all lines at once, which takes half the time; one by one where that fails, to name the line."""
    try:
        records = json.loads(b"[" + b",".join([line for _, line in lines]) + b"]")
    except (ValueError, RecursionError):
        records = []
    if len(records) != len(lines) or set(map(type, records)) != {dict}:
        records = [_record(source, *line) for line in lines]
    return [Row(number, record) for (number, _), record in zip(lines, records, strict=True)]


def _record(source: Source, number: int, line: bytes) -> dict[str, object]:
    try:
        record = json.loads(line)
    except (ValueError, RecursionError) as error:
        raise source.error(f"not JSON: {error}", number) from None
    if type(record) is not dict:
        raise source.error("not a map of BSM v1 fields", number)
    return record
