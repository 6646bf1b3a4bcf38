"""The state of one vehicle as bytes, for another process or site: versioned, and checked before anything is read.

A state is a line of JSON, the tables as they are in memory without the words that are zero, and a keyed checksum. The
numbers in the tables are indices and lengths too, so only a sender with the key of the receiver can make a state.
"""

import hashlib
import hmac
import json
import sys
from collections.abc import Mapping
from dataclasses import replace
from enum import StrEnum, unique
from io import BytesIO
from typing import Any, Final

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.snapshot import OpenEvent, OpenMiss
from headway.core.types.vehicle_state import Neighbours, VehicleState
from headway.edge.storage.packed import packed, unpacked

_FORMAT: Final = 1
_CHECKSUM_BYTES: Final = 16
_LOCAL_TIMES: Final = ("received_us", "age_us", "aged_us")
"""Columns of a track in the local time of its engine."""


@unique
class Refusal(StrEnum):
    """Why a state is not taken up."""

    DAMAGED = "damaged"
    """Cut short, changed on the way, or made without the key."""
    FOREIGN = "foreign"
    """Of another version, configuration or byte order."""


class VehicleStateCodec:
    """States of vehicles of one configuration to bytes and back.

    Parameters
    ----------
    parameters
        All that must be equal for a state to fit (`Identity.parameters`).
    key
        Secret that sender and receiver share, up to 64 bytes.
    """

    def __init__(self, config: DetectorConfig, parameters: Mapping[str, float | str], key: bytes) -> None:
        tables = Engine(replace(config, vehicle_capacity=1)).snapshot().tables
        self._types = {name: table.dtype for name, table in tables.items()}
        maker = {**parameters, "vehicle_capacity": 0.0, "format": _FORMAT, "byteorder": sys.byteorder}
        self._maker = hashlib.sha256(json.dumps(maker, sort_keys=True).encode()).hexdigest()[:16]
        self._key = key

    def encode(self, state: VehicleState, clock_offset_us: int) -> bytes:
        """Return the bytes of a state; with `clock_offset_us` added the local time of its engine is Unix time."""
        header = {
            "maker": self._maker,
            "clock_offset_us": clock_offset_us,
            "vehicle": state.vehicle,
            "neighbours": state.neighbours,
            "leader_place": state.leader_place,
            "event": state.event,
            "pair_event": state.pair_event,
            "miss": state.miss,
            "cleared_us": state.cleared_us,
        }
        tables = b"".join(piece for name in self._types for piece in packed(state.tables[name]))
        content = json.dumps(header, separators=(",", ":")).encode() + b"\n" + tables
        return content + self._checksum(content)

    def decode(self, payload: bytes, clock_offset_us: int) -> VehicleState | Refusal:
        """Return the state in the local time of an engine with `clock_offset_us`, or why it is refused."""
        content, checksum = payload[:-_CHECKSUM_BYTES], payload[-_CHECKSUM_BYTES:]
        if not hmac.compare_digest(self._checksum(content), checksum):
            return Refusal.DAMAGED
        file = BytesIO(content)
        header = json.loads(file.readline())
        if header["maker"] != self._maker:
            return Refusal.FOREIGN
        tables = {name: unpacked(file, 1, of) for name, of in self._types.items()}
        shift_us = header["clock_offset_us"] - clock_offset_us
        for name in _LOCAL_TIMES:
            tables["tracks"][name] += shift_us
        tables["first_received_us"] += shift_us
        return VehicleState(
            vehicle=header["vehicle"],
            tables=tables,
            neighbours=Neighbours(*header["neighbours"]),
            leader_place=tuple(header["leader_place"]),
            event=_opened(header["event"]),
            pair_event=_opened(header["pair_event"]),
            miss=OpenMiss(*header["miss"]) if header["miss"] is not None else None,
            cleared_us=tuple(header["cleared_us"]),
        )

    def _checksum(self, content: bytes) -> bytes:
        return hashlib.blake2b(content, digest_size=_CHECKSUM_BYTES, key=self._key).digest()


def _opened(event: list[Any] | None) -> OpenEvent | None:
    return OpenEvent(*event) if event is not None else None
