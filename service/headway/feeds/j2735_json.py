"""SAE J2735 basic safety messages in JSON, by named profile, as compact records of our own.

`raw`: the integers of part I with their sentinels. `ode`: the SI values of the USDOT Operational Data Environment,
null for unavailable save for accelerations, which keep the literal 2001; lengths in centimetres. From schema 9 on, ODE
messages are a MessageFrame in JER, whose values are the integers of `raw`: the form of the message says so, never its
values. A message may be inside the usual wrappers; numbers may be text, as in XER. The time is that of the envelope.

Values are converted, not validated: the model of our own messages validates them too. A value of a type that the
profile does not have becomes the name of its type, which no limit accepts.
"""

import re
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from headway.feeds import uper
from headway.feeds.identifiers import temporary_id
from headway.feeds.instants import envelope_us, within_minute_us
from headway.feeds.kinds import BSM, J2735_NAMES, kind_of
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, Refusal, Result
from headway_schemas.bsm import WIRE_VERSION

_WRAPPERS: Final = ("coreData", "MessageFrame", "payload", "data", "value", BSM, "bsm", "bytes")
"""Fields that hold the message, outermost first where one of these has several."""
_OF_MESSAGE_FRAME: Final = frozenset({"MessageFrame", BSM, "bsm"})
"""Wrappers of the integers of `raw`."""
_DEPTH_MAX: Final = 8
_V2X_HUB: Final = "BsmMessageContent"
_CORE_FIELDS: Final = frozenset({"secMark", "msgCnt", "lat", "long", "position", "accelSet"})
_INTEGER: Final = re.compile(r"\s*[+-]?\d{1,20}\s*")
_NUMBER: Final = re.compile(r"\s*[+-]?\d{1,20}(\.\d{1,20})?([eE][+-]?\d{1,3})?\s*")
_INTEGER_MAX: Final = 2**53
"""Far beyond every range, and still a double."""
_ACCEL_UNAVAILABLE: Final = 2001


class _Core(NamedTuple):
    fields: dict[str, Any]
    in_message_frame: bool


def messages_in(content: Any) -> list[Any]:
    """Return the messages of one JSON value: several in an array and in the `BsmMessageContent` of V2X-Hub."""
    messages = []
    for item in content if isinstance(content, list) else [content]:
        inner = item.get(_V2X_HUB) if isinstance(item, dict) else None
        messages += inner if isinstance(inner, list) and inner else [item]
    return messages


def from_raw(message: object, received_us: int) -> Result:
    """Convert one message of profile `raw`; without a time in its envelope the minute is that of `received_us`."""
    return _convert(message, received_us, _from_raw_core)


def _from_raw_core(core: _Core, reference_us: int) -> Result:
    if isinstance(core.fields.get("position"), dict):
        return Refusal(OTHER_MESSAGE, "coreData in SI units: the encoding of profile ode reads it")
    return _raw_record(core.fields, reference_us)


def from_ode(message: object, received_us: int) -> Result:
    """Convert one message of profile `ode`; without a time in its envelope the minute is that of `received_us`."""
    return _convert(message, received_us, _from_ode_core)


def _from_ode_core(core: _Core, reference_us: int) -> Result:
    if core.in_message_frame:
        return _raw_record(core.fields, reference_us)
    if "lat" in core.fields and "position" not in core.fields:
        return Refusal(OTHER_MESSAGE, "coreData in integers: the encoding of profile raw reads it")
    return _ode_record(core.fields, reference_us)


def _convert(message: object, received_us: int, convert: Callable[[_Core, int], Result]) -> Result:
    """Find time and core data of a message, and convert them."""
    reference_us = _envelope_us(message, received_us)
    core = _core_of(message, reference_us)
    if not isinstance(core, _Core):
        return core
    return reference_us if isinstance(reference_us, Refusal) else convert(core, reference_us)


def _envelope_us(message: object, received_us: int) -> int | Refusal:
    return envelope_us(message, received_us) if isinstance(message, dict) else received_us


def _raw_record(core: dict[str, Any], reference_us: int) -> Result:
    t_us = within_minute_us(_integer(core.get("secMark")), reference_us)
    if isinstance(t_us, Refusal):
        return t_us
    size = _part(core, "size")
    return [
        WIRE_VERSION,
        temporary_id(core.get("id")),
        _integer(core.get("msgCnt")),
        t_us,
        _scaled(core.get("lat"), 10_000_000, unavailable=900_000_001),
        _scaled(core.get("long"), 10_000_000, unavailable=1_800_000_001),
        _scaled(core.get("speed"), 50, unavailable=8191),
        _scaled(core.get("heading"), 80, unavailable=28800),
        _scaled(core.get("elev"), 10, unavailable=-4096),
        _scaled(_part(core, "accelSet").get("long"), 100, unavailable=_ACCEL_UNAVAILABLE),
        _scaled(_part(core, "accuracy").get("semiMajor"), 20, unavailable=255),
        _scaled(size.get("length"), 100, unavailable=0),
        _scaled(size.get("width"), 100, unavailable=0),
    ]


def _ode_record(core: dict[str, Any], reference_us: int) -> Result:
    t_us = within_minute_us(_integer(core.get("secMark")), reference_us)
    if isinstance(t_us, Refusal):
        return t_us
    position, size = _part(core, "position"), _part(core, "size")
    accel_mps2 = _number(_part(core, "accelSet").get("accelLong"))
    return [
        WIRE_VERSION,
        temporary_id(core.get("id")),
        _integer(core.get("msgCnt")),
        t_us,
        _number(position.get("latitude")),
        _number(position.get("longitude")),
        _number(core.get("speed")),
        _number(core.get("heading")),
        _number(position.get("elevation")),
        None if accel_mps2 == _ACCEL_UNAVAILABLE else accel_mps2,
        _number(_part(core, "accuracy").get("semiMajor")),
        _scaled(size.get("length"), 100, unavailable=0),
        _scaled(size.get("width"), 100, unavailable=0),
    ]


def _core_of(message: object, reference_us: int | Refusal) -> _Core | Result:
    """Return the core data within the wrappers; the record at once where they hold UPER; or why there is neither."""
    node, in_message_frame = message, False
    for _ in range(_DEPTH_MAX):
        if isinstance(node, str):
            return reference_us if isinstance(reference_us, Refusal) else uper.bsm_record(node, reference_us)
        inner = _inner(node)
        if inner is None:
            break
        if isinstance(inner, Refusal):
            return inner
        in_message_frame |= inner.in_message_frame
        node = inner.content
    if not isinstance(node, dict):
        return Refusal(MALFORMED, "no coreData")
    if _CORE_FIELDS.isdisjoint(node) or "t_us" in node:
        return Refusal(OTHER_MESSAGE, kind_of(node) or kind_of(message) or "no basic safety message")
    return _Core(node, in_message_frame)


class _Inner(NamedTuple):
    content: object
    in_message_frame: bool


def _inner(node: object) -> _Inner | Refusal | None:
    """Return what a wrapper holds; None if the node is no wrapper."""
    if isinstance(node, list):  # a choice as pycrate writes it: [name, value]
        is_bsm = len(node) == 2 and node[0] == BSM  # noqa: PLR2004 - a pair
        return (
            _Inner(node[1], in_message_frame=True)
            if is_bsm
            else Refusal(OTHER_MESSAGE, "a list that is no BasicSafetyMessage")
        )
    if not isinstance(node, dict):
        return None
    if "messageId" in node and _integer(node["messageId"]) != J2735_NAMES[BSM]:
        return _other_frame(node["messageId"])
    name = next((name for name in _WRAPPERS if name in node), None)
    return (
        None if name is None else _Inner(node[name], in_message_frame="messageId" in node or name in _OF_MESSAGE_FRAME)
    )


def _other_frame(message_id: object) -> Refusal:
    number = _integer(message_id)
    name = next((name for name, known in J2735_NAMES.items() if known == number), None)
    return Refusal(OTHER_MESSAGE, f"a {name}, no basic safety message" if name else "messageId is not 20")


def _part(core: dict[str, Any], name: str) -> dict[str, Any]:
    part = core.get(name)
    return part if isinstance(part, dict) else {}


def _integer(value: object) -> object:
    return int(value) if isinstance(value, str) and _INTEGER.fullmatch(value) else value


def _number(value: object) -> object:
    return float(value) if isinstance(value, str) and _NUMBER.fullmatch(value) else value


def _scaled(value: object, per_unit: int, *, unavailable: int) -> object:
    value = _integer(value)
    if type(value) is not int:
        return None if value is None else type(value).__name__
    return None if value == unavailable else max(-_INTEGER_MAX, min(value, _INTEGER_MAX)) / per_unit
