"""The drive of `made_files` in every form of a message that the bus carries."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any, Final

import msgpack
from gateways.recordings.made_files import (
    Reading,
    cam_uper,
    its_client_message,
    ode_message,
    raw_core,
    uper,
    vanetza_message,
)

from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK, CAM_JSON, CAM_UPER, J2735_ODE, J2735_RAW, J2735_UPER


@dataclass(frozen=True, slots=True)
class MessageForm:
    """How a reading is written as a message."""

    encoding: str
    write: Callable[[Reading], bytes]
    container: str = "lines"
    """What a recording of such messages is: `lines` of JSON, a `pcap`, or nothing."""


def _json(encoding: str, message: Callable[[Reading], Any]) -> MessageForm:
    return MessageForm(encoding, lambda one: json.dumps(message(one)).encode())


def _frames(frame: Callable[[Reading], bytes], encoding: str = J2735_UPER) -> MessageForm:
    return MessageForm(encoding, frame, "pcap")


def bsm_v1(one: Reading) -> dict[str, Any]:
    """Return a record of our own."""
    return {
        "v": 1, "id": str(one.car), "msg_cnt": one.step % 128, "t_us": one.t_us, "lat": one.lat, "lon": one.lon,
        "speed_mps": one.speed_mps, "heading_deg": 0.0,
    }  # fmt: skip


def _received(one: Reading) -> str:
    at = datetime.fromtimestamp(one.t_us / 1e6, UTC).isoformat(timespec="milliseconds")
    return f"{at.removesuffix('+00:00')}Z"


def _metadata(one: Reading) -> dict[str, str]:
    return {"recordGeneratedAt": "", "odeReceivedAt": _received(one)}


def _frame(core: object) -> dict[str, Any]:
    return {"messageId": 20, "value": {"BasicSafetyMessage": {"coreData": core}}}


def _hub(one: Reading, content: dict[str, Any]) -> dict[str, Any]:
    metadata = {"utctimestamp": _received(one), "originRsu": "10.0.0.7"}
    return {"BsmMessageContent": [{"metadata": metadata} | content]}


def _size(octets: bytes) -> bytes:
    return bytes([len(octets)]) if len(octets) < 128 else b"\x81" + bytes([len(octets)])


def unsecured(one: Reading) -> bytes:
    """Return IEEE 1609.2 data without a signature."""
    return b"\x03\x80" + _size(uper(one)) + uper(one)


def signed(one: Reading) -> bytes:
    """Return IEEE 1609.2 data; the signature is not one."""
    return b"\x03\x81\x00\x40" + unsecured(one) + b"\x40\x01\x20" + bytes(range(70))


def wave(octets: bytes) -> bytes:
    """Return an IEEE 1609.3 WAVE short message."""
    return b"\x03\x00\x20" + _size(octets).removeprefix(b"\x81") + octets


def _forwarded(one: Reading) -> bytes:
    return (
        b"Version=0.7\nType=BSM\nPSID=0x20\nPriority=7\nSignature=True\nPayload=" + signed(one).hex().encode() + b"\n"
    )


def _geonetworking(one: Reading) -> bytes:
    """Return a single-hop broadcast: basic, common and extended header, BTP-B, and the CAM at its port 2001."""
    payload = cam_uper(one)
    common = b"\x20\x50\x02\x00" + (4 + len(payload)).to_bytes(2, "big") + b"\x01\x00"
    return b"\x11\x00\x1a\x01" + common + bytes(28) + b"\x07\xd1\x00\x00" + payload


MESSAGES: Final[dict[str, MessageForm]] = {
    "BSM v1, msgpack": MessageForm(BSM_MSGPACK, lambda one: msgpack.packb(bsm_v1(one)), ""),
    "BSM v1, JSON": _json(BSM_JSON, bsm_v1),
    "ODE JSON, schema 3 to 8": _json(J2735_ODE, ode_message),
    "ODE JSON, `recordGeneratedAt` empty": _json(
        J2735_ODE, lambda one: ode_message(one) | {"metadata": _metadata(one)}
    ),
    "ODE JSON, schema 9": _json(
        J2735_ODE, lambda one: {"metadata": _metadata(one), "payload": {"data": _frame(raw_core(one))}}
    ),
    "ODE JSON, hex in `bytes`": _json(
        J2735_ODE, lambda one: {"metadata": _metadata(one), "payload": {"data": {"bytes": uper(one).hex()}}}
    ),
    "J2735 JSON, `MessageFrame`": _json(
        J2735_RAW, lambda one: {"metadata": _metadata(one), "data": {"MessageFrame": _frame(raw_core(one))}}
    ),
    "J2735 JSON, choice as a pair (pycrate)": _json(
        J2735_RAW,
        lambda one: {
            "metadata": _metadata(one),
            "data": {"messageId": 20, "value": ["BasicSafetyMessage", {"coreData": raw_core(one)}]},
        },
    ),
    "J2735 JSON, numbers as text": _json(
        J2735_RAW,
        lambda one: {"metadata": _metadata(one), "data": _frame({n: str(v) for n, v in raw_core(one).items()})},
    ),
    "V2X-Hub, JSON": _json(J2735_RAW, lambda one: _hub(one, {"bsm": {"coreData": raw_core(one)}})),
    "V2X-Hub, hex": _json(J2735_RAW, lambda one: _hub(one, {"payload": uper(one).hex()})),
    "J2735 JSON, SPaT": _json(
        J2735_RAW, lambda one: {"metadata": _metadata(one), "data": {"messageId": 19, "value": {"SPAT": {}}}}
    ),
    "CAM JSON, vanetza-nap": _json(CAM_JSON, vanetza_message),
    "CAM JSON, its-client": _json(CAM_JSON, its_client_message),
    "UPER, octets": _frames(uper),
    "UPER, hex": _frames(lambda one: uper(one).hex().encode()),
    "UPER behind IEEE 1609.3": _frames(lambda one: wave(uper(one))),
    "UPER behind IEEE 1609.2, unsecured": _frames(unsecured),
    "UPER behind IEEE 1609.2, signed": _frames(signed),
    "UPER behind IEEE 1609.3 and 1609.2": _frames(lambda one: wave(signed(one))),
    "IEEE 1609.2, encrypted": _frames(lambda _: b"\x03\x82" + bytes(80)),
    "UPER in text of an RSU": _frames(_forwarded),
    "UPER behind a vendor's header": _frames(lambda one: bytes(range(1, 23)) + uper(one)),
    "CAM in UPER": _frames(cam_uper, CAM_UPER),
    "CAM in UPER behind GeoNetworking": _frames(_geonetworking, CAM_UPER),
}
