"""VeReMi, its extension by F2MD, and VeReMi-NextGen: what one receiver logged in simulated traffic.

A message is a line of type 3, in NextGen an element of an array. Type 2 is the receiver's own position and no message.
Ground truth (type 4, `attackerType`, `attacker`) is kept apart, for scores only. The file of a receiver is a drive.
"""

import math
from collections.abc import Iterator, Mapping
from typing import Any, Final

from headway.feeds.refusal import MALFORMED, UNAVAILABLE, Refusal
from headway.gateways.recordings.local_plane import ORIGIN, course_deg
from headway.gateways.recordings.message_counts import MessageCounts
from headway.gateways.recordings.messages.json_values import NOT_JSON, json_values
from headway.gateways.recordings.order import by_drive
from headway.gateways.recordings.reader import START_US, Record, Row, Source, Truth
from headway.gateways.recordings.tables.cells import identifier
from headway_schemas.bsm import WIRE_VERSION

_OWN_POSITION, _MESSAGE, _GROUND_TRUTH = 2, 3, 4
_US_PER_S: Final = 1e6
_NS_PER_US: Final = 1000
_ACCEL_MAX_MPS2: Final = 20.0


class _FieldError(ValueError):
    """A field without a usable value."""


def recognise(head: bytes) -> bool:
    """Whether these first bytes are such a log."""
    return (b'"rcvTime"' in head or b'"attackerType"' in head) and (b'"pos"' in head or b'"type"' in head)


def read(source: Source) -> Iterator[Row]:
    """Yield the messages and the ground truth in the order of the file."""
    return by_drive(_rows(source))


def _rows(source: Source) -> Iterator[Row]:
    counts = MessageCounts()
    for number, content in json_values(source):
        for message in content if isinstance(content, list) else [content]:
            if message is NOT_JSON or not isinstance(message, dict):
                yield Row(number, {}, source.name, Refusal(MALFORMED, "not a JSON object"))
                continue
            kind = message.get("type", _MESSAGE)
            if kind == _OWN_POSITION:
                continue
            truth = _truth(message)
            if kind == _GROUND_TRUTH:
                yield Row(number, {}, source.name, truth=truth)
            else:
                yield _row(number, message, source.name, counts)._replace(truth=truth)


def _truth(message: Mapping[str, Any]) -> Truth | None:
    name = message.get("messageID")
    attack = message.get("attackerType", message.get("attacker"))
    known = type(attack) in (int, bool)
    return None if type(name) not in (int, str) else Truth(str(name), attack != 0 if known else None)


def _row(number: int, message: Mapping[str, Any], drive: str, counts: MessageCounts) -> Row:
    try:
        record = _record(message)
    except _FieldError as error:
        return Row(number, {}, drive, Refusal(UNAVAILABLE, f"{error}: no value of its kind"))
    except (ValueError, OverflowError):
        return Row(number, {}, drive, Refusal(MALFORMED, "a number that is no place, motion or time"))
    record["msg_cnt"] = counts.next(record["id"])
    return Row(number, record, drive)


def _record(message: Mapping[str, Any]) -> Record:
    inner = message.get("sender")
    body = inner if isinstance(inner, dict) else message
    x_m, y_m = _vector(body, "pos")
    heading_deg, speed_mps = _motion(body)
    lat, lon = ORIGIN.lat_lon(x_m, y_m)
    record: Record = {
        "v": WIRE_VERSION,
        "id": _sender(message),
        "t_us": _time_us(message, "sendTime" if "sendTime" in message else "rcvTime"),
        "lat": lat,
        "lon": lon,
        "speed_mps": speed_mps,
        "received_us": _time_us(message, "rcvTime"),
    }
    if heading_deg is not None:
        record["heading_deg"] = heading_deg
    accel = body.get("acl")
    if isinstance(accel, int | float) and abs(accel) <= _ACCEL_MAX_MPS2:
        record["accel_mps2"] = float(accel)
    return record


def _motion(body: Mapping[str, Any]) -> tuple[float | None, float]:
    """Return heading and speed, which are vectors, in NextGen numbers."""
    heading = body.get("hed")
    if isinstance(body.get("spd"), list):
        speed = _vector(body, "spd")
        toward = _vector(body, "hed") if isinstance(heading, list) else speed
        return course_deg(*toward), math.hypot(*speed)
    return None if heading is None else _number(heading, "hed") % 360.0, _number(body.get("spd"), "spd")


def _sender(message: Mapping[str, Any]) -> str:
    """Return the temporary id under which the message was sent."""
    names = ("senderPseudo", "sender_alias", "sender_id", "sender")
    name = next((message[name] for name in names if type(message.get(name)) in (int, str)), "")
    if name == "":
        raise _FieldError("sender")
    return identifier(str(name))


def _time_us(message: Mapping[str, Any], name: str) -> int:
    """Return the time, which is in seconds, in NextGen in nanoseconds."""
    value = _number(message.get(name), name)
    is_next_generation = isinstance(message.get("sender"), dict)
    return START_US + (int(message[name]) // _NS_PER_US if is_next_generation else round(value * _US_PER_S))


def _vector(body: Mapping[str, Any], name: str) -> tuple[float, float]:
    value = body.get(name)
    if not isinstance(value, list) or len(value) < 2:  # noqa: PLR2004 - east and north
        raise _FieldError(name)
    return _number(value[0], name), _number(value[1], name)


def _number(value: Any, name: str) -> float:
    if type(value) not in (int, float) or not math.isfinite(value):
        raise _FieldError(name)
    return float(value)
