"""JSON values of a recording: one in each line, over several lines, or the elements of an array of any length."""

import codecs
import json
from collections.abc import Iterator
from typing import Any, Final, NamedTuple

from headway.feeds.json_text import parsed
from headway.gateways.recordings.reader import BOM, Source

_VALUE_MAX: Final = 1 << 20
_BLOCK: Final = 1 << 16
_BETWEEN: Final = " \t\r\n,"


class Value(NamedTuple):
    """A value and its number: of its line, or within the array."""

    number: int
    content: Any
    """`NOT_JSON` where it cannot be read."""


class _NotJson:
    """What stands for a value that cannot be read."""


NOT_JSON: Final = _NotJson()


def json_values(source: Source) -> Iterator[Value]:
    """Yield the values of a recording; blank lines are left out."""
    head = source.head.removeprefix(BOM).lstrip()
    is_spread = head[:1] == b"[" or head.partition(b"\n")[0].strip() == b"{"
    return _elements(source) if is_spread else _lines(source)


def text_lines(source: Source) -> Iterator[tuple[int, bytes | None]]:
    """Yield each line that is not blank, and its number; None for one longer than a megabyte."""
    number = 0
    while line := source.stream.readline(_VALUE_MAX):
        number += 1
        if len(line) == _VALUE_MAX and not line.endswith(b"\n"):
            while (rest := source.stream.readline(_VALUE_MAX)) and not rest.endswith(b"\n"):
                pass
            yield number, None
        elif line := (line.removeprefix(BOM) if number == 1 else line).strip():
            yield number, line


def _lines(source: Source) -> Iterator[Value]:
    for number, line in text_lines(source):
        yield Value(number, NOT_JSON if line is None else _parsed(line))


def _parsed(line: bytes) -> Any:
    try:
        return parsed(line)
    except (ValueError, RecursionError):
        return NOT_JSON


def _elements(source: Source) -> Iterator[Value]:
    """Take one element after the other from an array; what cannot be read ends it."""
    decoder, utf8 = json.JSONDecoder(), codecs.getincrementaldecoder("utf-8")("replace")
    text, number = "", 0
    while True:
        text = text.lstrip(_BETWEEN if number else _BETWEEN + "[\ufeff")
        try:
            content, end = decoder.raw_decode(text)
            if end == len(text) and not isinstance(content, dict | list):  # a number may go on in the next block
                raise ValueError  # noqa: TRY301
        except (ValueError, RecursionError):
            block = source.stream.read1(_BLOCK) if len(text) < _VALUE_MAX else b""
            if block:
                text += utf8.decode(block)
                continue
            if text and text[0] != "]":
                yield Value(number + 1, NOT_JSON)
            return
        number += 1
        yield Value(number, content)
        text = text[end:]
