"""CSV of the Tampa pilot (THEA): the time of reception in milliseconds, direction, PSID, and a MessageFrame in XER."""

import re
from collections.abc import Iterator
from typing import Any, Final
from xml.etree import ElementTree as ET

from headway.feeds.j2735_json import from_raw
from headway.feeds.refusal import MALFORMED, Refusal, Result
from headway.gateways.recordings.messages.json_values import text_lines
from headway.gateways.recordings.messages.ode import row_of
from headway.gateways.recordings.reader import Row, Source

_LINE: Final = re.compile(rb"\s*\"?(\d{1,16})\"?\s*,.*?(<MessageFrame>.*</MessageFrame>)", re.DOTALL)
_DEPTH_MAX: Final = 16


def recognise(head: bytes) -> bool:
    """Whether these first bytes are such a table."""
    return b"<MessageFrame>" in head and not head.lstrip().startswith((b"<", b"{", b"["))


def read(source: Source) -> Iterator[Row]:
    """Yield the messages in the order of the file; a first line without a message is a header."""
    for number, line in text_lines(source):
        found = None if line is None else _LINE.match(line)
        if found is None:
            if number > 1:
                yield Row(number, {}, refusal=Refusal(MALFORMED, "no time and MessageFrame in the line"))
            continue
        received_us = int(found[1]) * 1000
        yield row_of(number, _record(found[2], received_us), received_us)


def _record(xer: bytes, received_us: int) -> Result:
    if b"<!" in xer:
        return Refusal(MALFORMED, "XER with a declaration")
    try:
        frame = ET.fromstring(xer)  # noqa: S314 - no declaration, so no entity
    except ET.ParseError:
        return Refusal(MALFORMED, "not XER")
    return from_raw(_content(frame, 0), received_us)


def _content(element: ET.Element, depth: int) -> Any:
    """Return the element as JER would have it, with numbers as text."""
    if not len(element):
        return element.text
    if depth == _DEPTH_MAX:
        return None
    return {child.tag: _content(child, depth + 1) for child in element}
