"""When a message was generated: the envelope decides the minute, the message the millisecond within it."""

import re
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any, Final
from zoneinfo import ZoneInfo

from headway.feeds.refusal import MALFORMED, OUT_OF_RANGE, UNAVAILABLE, UNREADABLE_TIME, Refusal

_EPOCH: Final = datetime(1970, 1, 1, tzinfo=UTC)
_MINUTE_US: Final = 60_000_000
_SEC_MARK_UNAVAILABLE: Final = 65535
_SEC_MARK_MAX: Final = 60999
"""60000 to 60999 are a leap second, 61000 and above reserved."""
_ENVELOPE: Final = ("recordGeneratedAt", "odeReceivedAt", "utctimestamp")
"""Fields of `metadata` with a time; the first that is not empty decides."""
_ZONED: Final = re.compile(r"(.+?)\s*(?:\[([\w/+-]+)\])?")
_BLANK_BEFORE_OFFSET: Final = re.compile(r"\s+(?=[+-]\d\d:?\d\d$)")
_US_FORMAT: Final = "%m/%d/%Y %I:%M:%S.%f %p%z"
_ABBREVIATIONS: Final = {
    "ET": "America/New_York",
    "CT": "America/Chicago",
    "MT": "America/Denver",
    "PT": "America/Los_Angeles",
    "Z": "UTC",
}


def instant_us(text: str) -> int | None:
    """Return microseconds since 1970 of a time with a zone; None if it is unreadable or has no zone.

    The zone is an offset, a name in brackets, or both; then the offset decides.
    """
    found = _ZONED.fullmatch(text.strip())
    if found is None:
        return None
    written, zone = found.groups()
    try:
        instant = _parse(_BLANK_BEFORE_OFFSET.sub("", written))
        if instant.tzinfo is None:
            if zone is None:
                return None
            instant = instant.replace(tzinfo=ZoneInfo(_ABBREVIATIONS.get(zone, zone)))
        since = instant - _EPOCH
    except (ValueError, OverflowError, OSError, LookupError):
        return None
    return (since.days * 86_400 + since.seconds) * 1_000_000 + since.microseconds


def _parse(written: str) -> datetime:
    try:
        return datetime.fromisoformat(written)
    except ValueError:
        return datetime.strptime(written, _US_FORMAT)  # noqa: DTZ007 - %z is in it


def envelope_us(message: Mapping[str, Any], received_us: int) -> int | Refusal:
    """Return the time of the envelope, that of reception where the envelope has none."""
    metadata = message.get("metadata")
    if not isinstance(metadata, dict):
        return received_us
    for name in _ENVELOPE:
        text = metadata.get(name)
        if text is None or (isinstance(text, str) and not text.strip()):
            continue
        instant = instant_us(text) if isinstance(text, str) else None
        return Refusal(UNREADABLE_TIME, f"{name} is no time with a zone") if instant is None else instant
    return received_us


def within_minute_us(sec_mark: object, reference_us: int) -> int | Refusal:
    """Return the time of `secMark`, milliseconds of a minute that the message does not name: the nearest one."""
    if sec_mark is None or sec_mark == _SEC_MARK_UNAVAILABLE:
        return Refusal(UNAVAILABLE, "secMark is unavailable")
    if type(sec_mark) is not int:
        return Refusal(MALFORMED, "secMark is not an integer")
    if not 0 <= sec_mark <= _SEC_MARK_MAX:
        return Refusal(OUT_OF_RANGE, f"secMark is not within 0 to {_SEC_MARK_MAX}")
    return nearest_us(sec_mark * 1000, _MINUTE_US, reference_us)


def nearest_us(offset_us: int, period_us: int, reference_us: int) -> int:
    """Return the time nearest to the reference that is `offset_us` after a multiple of the period."""
    age_us = (reference_us - offset_us) % period_us
    return reference_us - (age_us if age_us <= period_us // 2 else age_us - period_us)
