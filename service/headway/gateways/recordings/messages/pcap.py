"""Captures of what a roadside unit sent: a J2735 message or a CAM in each UDP datagram, UPER or JSON."""

from collections.abc import Iterator
from itertools import islice
from typing import Final

import numpy as np

from headway.feeds.cam_json import from_cam
from headway.feeds.j2735_json import messages_in
from headway.feeds.json_text import parsed
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, UNREADABLE_TIME, Refusal
from headway.feeds.uper import A_CAM, NAMES, UperRecords, read_bsms, read_cams
from headway.gateways.recordings.message_counts import MessageCounts
from headway.gateways.recordings.messages.cam import counted
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
    waiting, counts = packets(source), MessageCounts()
    while some := list(islice(waiting, _AT_ONCE)):
        whole = [packet for packet in some if packet.payload is not None and packet.received_us is not None]
        uper = [packet for packet in whole if not _is_json(packet.payload or b"")]
        rows = dict(zip((packet.number for packet in uper), _decoded(uper, counts), strict=True))
        for packet in some:
            if packet.payload is None:
                yield Row(packet.number, {}, refusal=_NO_PAYLOAD)
            elif packet.received_us is None:
                yield Row(packet.number, {}, refusal=_NO_TIME)
            elif packet.number in rows:
                yield rows[packet.number]
            else:
                yield from _from_json(packet, counts)


def _is_json(payload: bytes) -> bool:
    return payload.lstrip()[:1] in (b"{", b"[")


def _from_json(packet: Packet, counts: MessageCounts) -> Iterator[Row]:
    try:
        messages = messages_in(parsed(packet.payload or b""))
    except (ValueError, RecursionError):
        yield Row(packet.number, {}, refusal=Refusal(MALFORMED, "not JSON"))
        return
    for message in messages:
        result = j2735_record(message, packet.received_us or 0)
        row = row_of(packet.number, result, packet.received_us)
        if isinstance(result, Refusal) and result.reason == OTHER_MESSAGE:
            of_cam = row_of(packet.number, from_cam(message, packet.received_us or 0), packet.received_us)
            row = counted(of_cam, counts) if of_cam.refusal is None or of_cam.refusal.reason != OTHER_MESSAGE else row
        yield row


def _decoded(frames: list[Packet], counts: MessageCounts) -> Iterator[Row]:
    """Yield a row for each frame: of the BSM in it, else of the CAM."""
    payloads = [packet.payload or b"" for packet in frames]
    received_us = np.array([packet.received_us or 0 for packet in frames], np.int64)
    bsms = read_bsms(payloads, received_us)
    others = [i for i, refusal in bsms.refusals.items() if refusal == A_CAM]
    cams = read_cams([payloads[i] for i in others], received_us[others])
    places = {i: place for place, i in enumerate(others)}
    for i, packet in enumerate(frames):
        if i in places:
            yield counted(_row(packet, cams, places[i]), counts)
        else:
            yield _row(packet, bsms, i)


def _row(packet: Packet, read: UperRecords, place: int) -> Row:
    if place in read.refusals:
        return Row(packet.number, {}, refusal=read.refusals[place])
    record: Record = {"v": WIRE_VERSION, "id": read.ids[place].decode()}
    for name in NAMES:
        value = float(read.numbers[name][place])
        if value == value:  # noqa: PLR0124 - NaN: not given
            record[name] = int(value) if name in ("msg_cnt", "t_us") else value
    if packet.received_us is not None:
        record["received_us"] = packet.received_us
    return Row(packet.number, record)
