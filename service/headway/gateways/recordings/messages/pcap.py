"""Captures of what a roadside unit sent: a J2735 message in each UDP datagram, UPER or JSON."""

from collections.abc import Iterator
from itertools import islice
from typing import Final

import numpy as np

from headway.feeds.j2735_json import messages_in
from headway.feeds.json_text import parsed
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, UNREADABLE_TIME, Refusal
from headway.feeds.uper import NAMES, read_bsms
from headway.gateways.recordings.messages.ode import j2735_record, row_of
from headway.gateways.recordings.messages.packets import Packet, packets, recognise
from headway.gateways.recordings.reader import Record, Row, Source
from headway_schemas.bsm import WIRE_VERSION

__all__ = ["read", "recognise"]
_AT_ONCE: Final = 1_000
_NO_TIME: Final = Refusal(UNREADABLE_TIME, "a packet without a time")
_NO_PAYLOAD: Final = Refusal(OTHER_MESSAGE, "no whole UDP datagram")


def read(source: Source) -> Iterator[Row]:
    """Yield the messages in the order of reception; raises `RecordingError`."""
    waiting = packets(source)
    while some := list(islice(waiting, _AT_ONCE)):
        whole = [packet for packet in some if packet.payload is not None and packet.received_us is not None]
        uper = [packet for packet in whole if not _is_json(packet.payload or b"")]
        rows = dict(zip((packet.number for packet in uper), _decoded(uper), strict=True))
        for packet in some:
            if packet.payload is None:
                yield Row(packet.number, {}, refusal=_NO_PAYLOAD)
            elif packet.received_us is None:
                yield Row(packet.number, {}, refusal=_NO_TIME)
            elif packet.number in rows:
                yield rows[packet.number]
            else:
                yield from _from_json(packet)


def _is_json(payload: bytes) -> bool:
    return payload.lstrip()[:1] in (b"{", b"[")


def _from_json(packet: Packet) -> Iterator[Row]:
    try:
        messages = messages_in(parsed(packet.payload or b""))
    except (ValueError, RecursionError):
        yield Row(packet.number, {}, refusal=Refusal(MALFORMED, "not JSON"))
        return
    for message in messages:
        yield row_of(packet.number, j2735_record(message, packet.received_us or 0), packet.received_us)


def _decoded(frames: list[Packet]) -> Iterator[Row]:
    received_us = np.array([packet.received_us or 0 for packet in frames], np.int64)
    read = read_bsms([packet.payload or b"" for packet in frames], received_us)
    for i, packet in enumerate(frames):
        if i in read.refusals:
            yield Row(packet.number, {}, refusal=read.refusals[i])
            continue
        record: Record = {"v": WIRE_VERSION, "id": read.ids[i].decode()}
        for name in NAMES:
            value = float(read.numbers[name][i])
            if value == value:  # noqa: PLR0124 - NaN: not given
                record[name] = int(value) if name in ("msg_cnt", "t_us") else value
        if packet.received_us is not None:
            record["received_us"] = packet.received_us
        yield Row(packet.number, record)
