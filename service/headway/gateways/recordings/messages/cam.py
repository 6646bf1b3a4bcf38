"""ETSI CAM in the JSON of vanetza-nap or its-client: a message in each line, or the elements of an array."""

from collections.abc import Iterator
from typing import Any, Final

from headway.feeds.cam_json import from_cam
from headway.feeds.refusal import MALFORMED, UNREADABLE_TIME, Refusal, Result
from headway.gateways.recordings.message_counts import MessageCounts
from headway.gateways.recordings.messages.json_values import NOT_JSON, json_values
from headway.gateways.recordings.messages.ode import row_of
from headway.gateways.recordings.reader import Row, Source
from headway_schemas.bsm import FIELDS

_T_US: Final = FIELDS.index("t_us")
_MINUTE_US: Final = 60_000_000
_NOT_A_MESSAGE: Final = Refusal(MALFORMED, "not JSON")
_MARKS: Final = (b'"generationDeltaTime"', b'"generation_delta_time"')


def recognise(head: bytes) -> bool:
    """Whether these first bytes are CAM in JSON."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[") and any(mark in head for mark in _MARKS)


def read(source: Source) -> Iterator[Row]:
    """Yield the messages in the order of the file."""
    counts = MessageCounts()
    for number, content in json_values(source):
        for message in content if isinstance(content, list) else [content]:
            result = _NOT_A_MESSAGE if message is NOT_JSON else _converted(message)
            yield counted(row_of(number, result), counts)


def counted(row: Row, counts: MessageCounts) -> Row:
    """Return the row of a CAM with a message count, which it does not have; one without an id is refused later."""
    if "id" in row.record:
        row.record["msg_cnt"] = counts.next(str(row.record["id"]))
    return row


def _converted(message: Any) -> Result:
    """Convert a message; without a time in its envelope it would be within the first minute of 1970."""
    result = from_cam(message, 0)
    if not isinstance(result, Refusal) and result[_T_US] <= _MINUTE_US:
        return Refusal(UNREADABLE_TIME, "no time in the envelope")
    return result
