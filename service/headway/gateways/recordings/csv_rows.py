"""Rows of CSV, none of them longer than memory allows."""

import csv
import io
from collections.abc import Iterator
from typing import Any, Final

_ROW_MAX: Final = 1_000_000
"""Characters of a row, over all its lines."""


class CsvRows(Iterator[list[str]]):
    """The rows of a text, in a dialect of `csv.reader`.

    Raises
    ------
    csv.Error
        A row cannot be taken apart or is too long. Later rows can be asked for.
    """

    def __init__(self, text: io.TextIOBase, **dialect: Any) -> None:
        csv.field_size_limit(_ROW_MAX)
        self._text = text
        self._taken = 0
        self.line_num = 0
        """How many lines have been read."""
        self._rows = csv.reader(iter(self._line, ""), **dialect)

    def __next__(self) -> list[str]:
        self._taken = 0
        return next(self._rows)

    def _line(self) -> str:
        line = self._text.readline(_ROW_MAX)
        self.line_num += bool(line)
        self._taken += len(line)
        if self._taken < _ROW_MAX:
            return line
        while line and not line.endswith(("\n", "\r")):
            line = self._text.readline(_ROW_MAX)
        raise csv.Error(f"a row longer than {_ROW_MAX:,} characters")
