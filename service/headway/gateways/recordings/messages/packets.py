"""Captured packets: classic pcap and pcapng, down to the payload of UDP.

References: IETF drafts of pcap and pcapng; link types by their registered numbers. Fragments are not put together.
"""

import struct
from collections.abc import Callable, Iterator
from typing import Final, NamedTuple

from headway.gateways.recordings.reader import RecordingError, Source
from headway_schemas.fields import T_US_MAX

_PACKET_MAX: Final = 1 << 20
_CLASSIC: Final = {
    b"\xd4\xc3\xb2\xa1": ("<", 1000), b"\xa1\xb2\xc3\xd4": (">", 1000),
    b"\x4d\x3c\xb2\xa1": ("<", 1), b"\xa1\xb2\x3c\x4d": (">", 1),
}  # fmt: skip
"""Byte order, and nanoseconds in the fraction of a time."""
_SECTION: Final = b"\x0a\x0d\x0d\x0a"
_SECTION_BLOCK, _INTERFACE, _SIMPLE, _ENHANCED = 0x0A0D0D0A, 1, 3, 6
_LITTLE: Final = b"\x4d\x3c\x2b\x1a"
_TIME_RESOLUTION: Final = 9
_ETHERNET, _NULL, _LINUX_COOKED, _LINUX_COOKED_2 = 1, 0, 113, 276
_RAW_IP: Final = (12, 14, 101, 228, 229)
_VLAN: Final = (0x8100, 0x88A8)
_UDP: Final = 17
_NS_PER_US: Final = 1000


class Packet(NamedTuple):
    """A packet of a capture; `payload` is None where it holds no whole UDP datagram."""

    number: int
    received_us: int | None
    payload: bytes | None


class _Cut(Exception):  # noqa: N818 - the end of a capture, not a fault of ours
    """The capture ends within a packet."""


class _Interface(NamedTuple):
    link_type: int
    ns_per_tick: float


def recognise(head: bytes) -> bool:
    """Whether these first bytes are a capture."""
    return head[:4] in _CLASSIC or head[:4] == _SECTION


def packets(source: Source) -> Iterator[Packet]:
    """Yield the packets; one that is cut is the last, without payload; raises `RecordingError`."""
    walk = _pcapng if source.head[:4] == _SECTION else _classic
    number = 0
    try:
        for link_type, time_ns, data in walk(source):
            number += 1
            received_us = None if time_ns is None or time_ns // _NS_PER_US > T_US_MAX else time_ns // _NS_PER_US
            yield Packet(number, received_us, udp_payload(link_type, data))
    except (_Cut, struct.error):
        if not number:
            raise RecordingError(f"{source.name}: cut before its first packet") from None
        yield Packet(number + 1, None, None)


def _exactly(source: Source, size: int) -> bytes:
    if size > _PACKET_MAX:
        raise _Cut
    data = source.stream.read(size)
    if len(data) < size:
        raise _Cut
    return data


def _classic(source: Source) -> Iterator[tuple[int, int | None, bytes]]:
    form = _CLASSIC.get(_exactly(source, 4))
    if form is None:
        raise source.error("neither pcap nor pcapng")
    order, ns_per_fraction = form
    link_type = struct.unpack(f"{order}HHiIII", _exactly(source, 20))[-1] & 0x0FFF_FFFF
    while head := source.stream.read(16):
        seconds, fraction, size, _ = struct.unpack(f"{order}IIII", head)
        yield link_type, seconds * 1_000_000_000 + fraction * ns_per_fraction, _exactly(source, size)


def _pcapng(source: Source) -> Iterator[tuple[int, int | None, bytes]]:
    order, interfaces = "<", list[_Interface]()
    while head := source.stream.read(8):
        if head[:4] == _SECTION:
            order_mark = _exactly(source, 4)
            order = "<" if order_mark == _LITTLE else ">"
            size = struct.unpack(f"{order}I", head[4:8])[0]
            _exactly(source, max(size - 12, 0))
            interfaces = []
            continue
        kind, size = struct.unpack(f"{order}II", head)
        body = _exactly(source, max(size - 8, 0))[:-4]
        if kind == _INTERFACE:
            interfaces.append(_interface(order, body))
        elif kind == _ENHANCED:
            which, high, low, length, _ = struct.unpack_from(f"{order}IIIII", body)
            if which >= len(interfaces):
                raise _Cut
            at = interfaces[which]
            yield at.link_type, int((high << 32 | low) * at.ns_per_tick), body[20 : 20 + length]
        elif kind == _SIMPLE and interfaces:
            yield interfaces[0].link_type, None, body[4:]


def _interface(order: str, body: bytes) -> _Interface:
    link_type = struct.unpack_from(f"{order}H", body)[0]
    ns_per_tick, at = 1000.0, 8
    while at + 4 < len(body):
        code, size = struct.unpack_from(f"{order}HH", body, at)
        if code == _TIME_RESOLUTION and size >= 1:
            resolution = body[at + 4]
            ns_per_tick = 1e9 / (2.0 ** (resolution & 127) if resolution & 128 else 10.0 ** min(resolution, 30))
        if code == 0:
            break
        at += 4 + size + -size % 4
    return _Interface(link_type, ns_per_tick)


def udp_payload(link_type: int, data: bytes) -> bytes | None:
    """Return the payload of a whole UDP datagram in a packet; None where there is none."""
    try:
        at = _LINKS[link_type](data) if link_type in _LINKS else (0 if link_type in _RAW_IP else None)
        return None if at is None else _of_ip(data[at:])
    except (struct.error, IndexError):
        return None


def _ethernet(data: bytes) -> int:
    at = 12
    while struct.unpack_from(">H", data, at)[0] in _VLAN:
        at += 4
    return at + 2


_LINKS: Final[dict[int, Callable[[bytes], int]]] = {
    _ETHERNET: _ethernet,
    _NULL: lambda _: 4,
    _LINUX_COOKED: lambda _: 16,
    _LINUX_COOKED_2: lambda _: 20,
}
"""Bytes before the IP header."""


def _of_ip(packet: bytes) -> bytes | None:
    version = packet[0] >> 4
    if version == 4:  # noqa: PLR2004 - IP
        at, is_fragment = (packet[0] & 15) * 4, struct.unpack_from(">H", packet, 6)[0] & 0x3FFF
        if packet[9] != _UDP or is_fragment or at < 20:  # noqa: PLR2004 - the least header
            return None
    elif version == 6:  # noqa: PLR2004 - IP
        at = 40
        if packet[6] != _UDP:
            return None
    else:
        return None
    size = struct.unpack_from(">H", packet, at + 4)[0]
    payload = packet[at + 8 : at + size]
    return payload if len(payload) == size - 8 and payload else None
