"""JSON of the USDOT Operational Data Environment, and any other J2735 JSON: a message in each line."""

from collections.abc import Iterator
from typing import Any, Final

from headway.feeds.j2735_json import from_ode, from_raw, messages_in
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, UNREADABLE_TIME, Refusal, Result
from headway.gateways.recordings.messages.json_values import NOT_JSON, json_values
from headway.gateways.recordings.reader import Record, Row, Source
from headway_schemas.bsm import FIELDS

_T_US: Final = FIELDS.index("t_us")
_MINUTE_US: Final = 60_000_000
_NOT_A_MESSAGE: Final = Refusal(MALFORMED, "not JSON")
_MARKS: Final = (
    b'"coreData"',
    b'"metadata"',
    b'"MessageFrame"',
    b'"messageId"',
    b'"BasicSafetyMessage"',
    b'"BsmMessageContent"',
)


def recognise(head: bytes) -> bool:
    """Whether these first bytes are J2735 in JSON."""
    return head.removeprefix(b"\xef\xbb\xbf").lstrip()[:1] in (b"{", b"[") and any(mark in head for mark in _MARKS)


def read(source: Source) -> Iterator[Row]:
    """Yield the messages in the order of the file."""
    for number, content in json_values(source):
        if content is NOT_JSON:
            yield Row(number, {}, refusal=_NOT_A_MESSAGE)
            continue
        for message in messages_in(content):
            yield row_of(number, _converted(message))


def _converted(message: Any) -> Result:
    """Convert a message; without a time in its envelope it would be within the first minute of 1970."""
    result = j2735_record(message, 0)
    if not isinstance(result, Refusal) and result[_T_US] <= _MINUTE_US:
        return Refusal(UNREADABLE_TIME, "no time in the envelope")
    return result


def j2735_record(message: Any, received_us: int) -> Result:
    """Convert a message in whichever profile it has."""
    result = from_ode(message, received_us)
    if isinstance(result, Refusal) and result.reason == OTHER_MESSAGE:
        raw = from_raw(message, received_us)
        return result if isinstance(raw, Refusal) and raw.reason == OTHER_MESSAGE else raw
    return result


def row_of(number: int, result: Result, received_us: int | None = None) -> Row:
    """Return the row of a compact record, or of why there is none."""
    if isinstance(result, Refusal):
        return Row(number, {}, refusal=result)
    record: Record = {name: value for name, value in zip(FIELDS, result, strict=False) if value is not None}
    if received_us is not None:
        record["received_us"] = received_us
    return Row(number, record)
