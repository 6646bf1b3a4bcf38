"""Events as misbehaviour reports in the terms of ETSI TS 103 759, in JSON.

A report names what the standard names: targets and observations, time and application. Observations without a known
number stand beside it under `headway`. The original messages of the suspect are its evidence, as IEEE 1609.2 data. The
report is not signed.
"""

import base64
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import IO, Any, Final

ITS_EPOCH_US: Final = 1_072_915_200_000_000
"""2004-01-01 in Unix time."""
LEAP_SECONDS_US: Final = 5_000_000
"""Since then. The time of a report is TAI, which counts them."""
AID_CA_BSM: Final = 32
"""PSID of the basic safety message."""
_VERSION: Final = 1
_UNKNOWN_PLACE: Final = {"latitude": 900_000_001, "longitude": 1_800_000_001, "elevation": 61_440}
"""An event has a place along the road, none on the globe."""

_NAMED: Final = {
    "interval": (0, 1, "Beacon-IntervalTooSmall"),
    "position_change": (3, 4, "Position-ChangeTooLarge"),
    "speed_change": (4, 5, "Speed-ChangeTooLarge"),
    "acceleration": (5, 4, "LongAcc-ValueTooLarge"),
}
"""Our observation: target, observation, and its name in the standard."""
_LOCAL_FIELDS: Final = (
    "event_id", "phase", "kind", "sensor", "suspect", "leader", "follower", "site", "etsi_target", "observations",
    "statistic", "gate", "p_value", "confidence", "model", "config_hash",
)  # fmt: skip


_IEEE1609_DOT2_DATA: Final = 2
"""Type of a stream of messages."""
_SECURED: Final = (b"\x03\x80", b"\x03\x81")
"""First octets of IEEE 1609.2 data, unsecured and signed."""


def report_of(event: dict[str, Any]) -> dict[str, Any]:
    """Return the report of one event update, in its JSON form."""
    by_target: dict[int, list[dict[str, Any]]] = {}
    for observation in event["observations"]:
        if observation in _NAMED:
            target, number, name = _NAMED[observation]
            by_target.setdefault(target, []).append({"obsId": number, "obs": name})
    messages = (event["evidence"] or {}).get("messages", [])
    content = {
        "observations": [{"tgtId": target, "observations": found} for target, found in sorted(by_target.items())],
        "v2xPduEvidence": _streams([base64.b64decode(message["payload"]) for message in messages]),
        "nonV2xPduEvidence": [],
    }
    return {
        "version": _VERSION,
        "generationTime": event["detected_us"] - ITS_EPOCH_US + LEAP_SECONDS_US,
        "observationLocation": _UNKNOWN_PLACE,
        "report": {"aid": AID_CA_BSM, "content": content},
        "headway": {name: event.get(name) for name in _LOCAL_FIELDS}
        | {"messages": [{name: message[name] for name in ("received_us", "encoding")} for message in messages]},
    }


def _streams(messages: Sequence[bytes]) -> list[dict[str, Any]]:
    """Return the messages of one sender, the newest one being that of the report; nothing without a message."""
    if not messages:
        return []
    pdus = [_ieee1609_data(message).hex().upper() for message in messages]
    return [{"type": _IEEE1609_DOT2_DATA, "v2xPdus": pdus, "subjectPduIndex": len(pdus) - 1}]


def _ieee1609_data(message: bytes) -> bytes:
    """Return a message as it is where it is IEEE 1609.2 data, else as the content of unsecured data.

    Hex digits are the octets that they stand for.
    """
    with suppress(ValueError):
        message = bytes.fromhex(message.decode("ascii"))
    if message.startswith(_SECURED):
        return message
    size = len(message)
    octets = size.to_bytes((size.bit_length() + 7) // 8 or 1, "big")
    long_form = bytes([0x80 | len(octets)]) if size >= 0x80 else b""  # noqa: PLR2004 - the short form has seven bits
    return _SECURED[0] + long_form + octets + message


def reports(stored: Iterable[bytes]) -> Iterator[dict[str, Any]]:
    """Yield a report for each onset and update; the end of an event is none."""
    for line in stored:
        event = json.loads(line)
        if event["phase"] != "cleared":
            yield report_of(event)


def write_reports(stored: Iterable[bytes], to: IO[bytes]) -> int:
    """Write reports, a line of JSON each. Return how many."""
    return sum(1 for report in reports(stored) if to.write(json.dumps(report).encode() + b"\n"))
