"""A bundle of messages of another system as a gateway puts it: each as it came, when, and from where.

For every encoding that is not of BSM v1, a payload is one message or a msgpack array of frames `[octets, received_us,
source]`. So one message that cannot be read spoils no other, and the time of reception is that of the gateway.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import msgpack

from headway_schemas.fields import T_US_MAX

_FIX_ARRAY, _FIX_ARRAY_END, _ARRAY_16, _ARRAY_32 = 0x90, 0xA0, 0xDC, 0xDD
_PARTS: Final = 3


class Frame(NamedTuple):
    """One message as a gateway received it."""

    payload: bytes
    received_us: int
    """Unix time in microseconds."""
    source: str
    """Address or topic; empty where unknown."""


def is_bundle(payload: bytes) -> bool:
    """Whether the payload begins as a msgpack array, which neither text nor any frame of J2735 or ETSI does."""
    first = payload[0] if payload else 0
    return _FIX_ARRAY <= first < _FIX_ARRAY_END or first in (_ARRAY_16, _ARRAY_32)


def pack(frames: Sequence[Frame]) -> bytes:
    """Return the payload of a bundle."""
    packed: bytes = msgpack.packb(frames)
    return packed


def unpack(payload: bytes, frames_max: int) -> list[Frame]:
    """Return the frames of a bundle.

    Raises
    ------
    ValueError
        It is no bundle, or has more than `frames_max` frames.
    """
    content = msgpack.unpackb(payload, max_array_len=max(frames_max, _PARTS), max_map_len=0)
    if type(content) is not list or not all(map(_is_frame, content)):
        raise ValueError("no bundle of frames")
    return [Frame(*parts) for parts in content]


def _is_frame(parts: object) -> bool:
    return type(parts) is list and list(map(type, parts)) == [bytes, int, str] and 0 <= parts[1] <= T_US_MAX
