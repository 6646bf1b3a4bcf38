"""SAE J2735 basic safety messages in JSON, by named profile, as compact records of our own.

`raw`: the integers of part I with their sentinels. `ode`: the SI values of the USDOT Operational Data Environment,
null for unavailable save for accelerations, which keep the literal 2001; lengths in centimetres. A message may be
inside the usual wrappers of the two. Values are converted, not validated: the model of our own messages validates them
too. A value of a type that the profile does not have becomes the name of its type, which no limit accepts.
"""

from datetime import datetime
from typing import Any, Final

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import RejectReason
from headway_schemas.bsm import WIRE_VERSION

_WRAPPERS: Final = ("payload", "data", "value", "BasicSafetyMessage", "coreData")
_INTEGER_MAX: Final = 2**53
"""Far beyond every range, and still a double."""
_ACCEL_UNAVAILABLE: Final = 2001
_MINUTE_US: Final = 60_000_000
_SEC_MARK_UNAVAILABLE: Final = 65535
_SEC_MARK_MAX: Final = 60999
"""60000 to 60999 are a leap second, 61000 and above reserved."""


def from_raw(message: object, received_us: int) -> list[Any] | RejectReason:
    """Convert one message of profile `raw`; its minute is the one nearest to `received_us`."""
    core = _core_data(message)
    if core is None:
        return RejectReason(Outcome.MALFORMED, "no coreData")
    t_us = _t_us(core.get("secMark"), received_us)
    if isinstance(t_us, RejectReason):
        return t_us
    size = _part(core, "size")
    return [
        WIRE_VERSION,
        core.get("id"),
        core.get("msgCnt"),
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


def from_ode(message: object, received_us: int) -> list[Any] | RejectReason:
    """Convert one message of profile `ode`; its minute is the one nearest to `recordGeneratedAt`, else to receipt."""
    core = _core_data(message)
    if core is None:
        return RejectReason(Outcome.MALFORMED, "no coreData")
    t_us = _t_us(core.get("secMark"), _generated_us(message) or received_us)
    if isinstance(t_us, RejectReason):
        return t_us
    position, size = _part(core, "position"), _part(core, "size")
    accel_mps2 = _part(core, "accelSet").get("accelLong")
    return [
        WIRE_VERSION,
        core.get("id"),
        core.get("msgCnt"),
        t_us,
        position.get("latitude"),
        position.get("longitude"),
        core.get("speed"),
        core.get("heading"),
        position.get("elevation"),
        None if accel_mps2 == _ACCEL_UNAVAILABLE else accel_mps2,
        _part(core, "accuracy").get("semiMajor"),
        _scaled(size.get("length"), 100, unavailable=0),
        _scaled(size.get("width"), 100, unavailable=0),
    ]


def _core_data(message: object) -> dict[str, Any] | None:
    for wrapper in _WRAPPERS:
        if isinstance(message, dict):
            message = message.get(wrapper, message)
    return message if isinstance(message, dict) else None


def _part(core: dict[str, Any], name: str) -> dict[str, Any]:
    part = core.get(name)
    return part if isinstance(part, dict) else {}


def _scaled(value: object, per_unit: int, *, unavailable: int) -> object:
    if type(value) is not int:
        return None if value is None else type(value).__name__
    return None if value == unavailable else max(-_INTEGER_MAX, min(value, _INTEGER_MAX)) / per_unit


def _t_us(sec_mark: object, reference_us: int) -> int | RejectReason:
    """Return the time of `secMark`, milliseconds within a minute that the message does not name."""
    if sec_mark is None or sec_mark == _SEC_MARK_UNAVAILABLE:
        return RejectReason(Outcome.UNAVAILABLE, "secMark is unavailable")
    if type(sec_mark) is not int:
        return RejectReason(Outcome.MALFORMED, "secMark is not an integer")
    if not 0 <= sec_mark <= _SEC_MARK_MAX:
        return RejectReason(Outcome.OUT_OF_RANGE, f"secMark is not within 0 to {_SEC_MARK_MAX}")
    age_us = (reference_us - sec_mark * 1000) % _MINUTE_US
    return reference_us - (age_us if age_us <= _MINUTE_US // 2 else age_us - _MINUTE_US)


def _generated_us(message: object) -> int | None:
    metadata = message.get("metadata") if isinstance(message, dict) else None
    text = metadata.get("recordGeneratedAt") if isinstance(metadata, dict) else None
    if not isinstance(text, str):
        return None
    try:
        generated = datetime.fromisoformat(text.removesuffix("[UTC]"))
    except ValueError:
        return None
    return None if generated.tzinfo is None else round(generated.timestamp() * 1e6)
