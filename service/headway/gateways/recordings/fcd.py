"""Floating car data of SUMO (`--fcd-output`), XML, with `--fcd-output.geo` or with the metres of the network."""

import math
from collections.abc import Iterator
from itertools import chain
from typing import BinaryIO, Final, NamedTuple, cast
from xml.etree import ElementTree as ET

from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, UNAVAILABLE, Refusal
from headway.gateways.recordings.local_plane import ORIGIN
from headway.gateways.recordings.message_counts import MessageCounts
from headway.gateways.recordings.order import by_drive
from headway.gateways.recordings.reader import START_US, Record, Row, Source
from headway.gateways.recordings.tables.cells import identifier, number
from headway_schemas.bsm import WIRE_VERSION

_STEPS_TO_DECIDE: Final = 200
_METRES_FROM: Final = 1e-2
"""Share of the driven distance by which coordinates change at least where they are metres: a degree is 1e5 of them."""
_READ_BYTES: Final = 65_536
_SILENT_BYTES_MAX: Final = 1_000_000
"""Without the beginning or end of an element: expat reads an unfinished one again at each piece."""
_DEPTH_MAX: Final = 100
_ACCEL_MAX_MPS2: Final = 20.0


class _Seen(NamedTuple):
    """A vehicle in a time step."""

    number: int
    t_s: float
    vehicle: str
    x: float
    y: float
    speed_mps: float
    heading_deg: float | None
    accel_mps2: float | None


def recognise(head: bytes) -> bool:
    """Whether these first bytes are such a file."""
    return b"<fcd-export" in head


def read(source: Source) -> Iterator[Row]:
    """Yield a record for each vehicle of each step, in the order of time."""
    return by_drive(_rows(source))


def _rows(source: Source) -> Iterator[Row]:
    seen = _seen(source)
    waiting: list[_Seen | Row] = []
    is_geo: bool | None = None  # the options in the head say it also where the network has no projection
    last: dict[str, _Seen] = {}
    while is_geo is None and (one := next(seen, None)) is not None:
        waiting.append(one)
        if isinstance(one, _Seen):
            is_geo = _by_motion(last.get(one.vehicle), one)
            last[one.vehicle] = one
        if len(waiting) >= _STEPS_TO_DECIDE * 100:
            break
    if is_geo is None:
        places = [one for one in waiting if isinstance(one, _Seen)]
        is_geo = all(abs(one.x) <= 180.0 and abs(one.y) <= 90.0 for one in places)  # noqa: PLR2004 - degrees
    counts = MessageCounts()
    for one in chain(waiting, seen):
        yield one._replace(drive=source.name) if isinstance(one, Row) else _row(one, source.name, counts, is_geo=is_geo)


def _by_motion(before: _Seen | None, now: _Seen) -> bool | None:
    """Return whether coordinates are degrees, by how far they change; None where the vehicle has hardly moved."""
    driven_m = 0.0 if before is None else before.speed_mps * (now.t_s - before.t_s)
    if before is None or driven_m < 0.1:  # noqa: PLR2004 - beyond the rounding of the file
        return None
    return math.hypot(now.x - before.x, now.y - before.y) < _METRES_FROM * driven_m


def _row(one: _Seen, drive: str, counts: MessageCounts, *, is_geo: bool) -> Row:
    try:
        lat, lon = (one.y, one.x) if is_geo else ORIGIN.lat_lon(one.x, one.y)
        t_us = START_US + round(one.t_s * 1e6)
    except (ValueError, OverflowError):
        return Row(one.number, {}, drive, Refusal(MALFORMED, "a number that is no place or time"))
    record: Record = {
        "v": WIRE_VERSION,
        "id": one.vehicle,
        "msg_cnt": counts.next(one.vehicle),
        "t_us": t_us,
        "lat": lat,
        "lon": lon,
        "speed_mps": one.speed_mps,
    }
    if one.heading_deg is not None:
        record["heading_deg"] = one.heading_deg % 360.0
    if one.accel_mps2 is not None and abs(one.accel_mps2) <= _ACCEL_MAX_MPS2:
        record["accel_mps2"] = one.accel_mps2
    return Row(one.number, record, drive)


def _seen(source: Source) -> Iterator[_Seen | Row]:
    """Parse step by step; what has been read is released. The number is that of the vehicle element."""
    number_, t_s, within = 0, math.nan, list[ET.Element]()
    try:
        for event, element in _events(source.stream):
            if event == "start":
                within.append(element)
                t_s = _time_s(element.get("time", "")) if element.tag == "timestep" else t_s
                continue
            del within[-1]
            if within:
                del within[-1][:]
            if element.tag in ("vehicle", "person", "container"):
                number_ += 1
                yield _vehicle(number_, t_s, element)
    except ET.ParseError:
        yield Row(number_ + 1, {}, refusal=Refusal(MALFORMED, "the XML is cut or damaged: it ends here"))


def _events(stream: BinaryIO) -> Iterator[tuple[str, ET.Element]]:
    """Yield where elements begin and end; raises `ParseError`, also where none does for too long."""
    parser: ET.XMLPullParser[ET.Element] = ET.XMLPullParser(("start", "end"))
    silent = depth = 0
    is_open = True
    while is_open:
        is_open = bool(chunk := stream.read(_READ_BYTES))
        parser.feed(chunk) if is_open else parser.close()
        silent += len(chunk)
        for event, element in cast("Iterator[tuple[str, ET.Element]]", parser.read_events()):
            silent, depth = 0, depth + (1 if event == "start" else -1)
            yield event, element
        if silent > _SILENT_BYTES_MAX or depth > _DEPTH_MAX:
            raise ET.ParseError


def _vehicle(number_: int, t_s: float, element: ET.Element) -> _Seen | Row:
    if element.tag != "vehicle":
        return Row(number_, {}, refusal=Refusal(OTHER_MESSAGE, f"a {element.tag}, no vehicle"))
    try:
        x, y, speed, angle, accel = (number(element.get(name)) for name in ("x", "y", "speed", "angle", "acceleration"))
    except ValueError:
        return Row(number_, {}, refusal=Refusal(MALFORMED, "an attribute that is no number"))
    vehicle = element.get("id", "")
    if x is None or y is None or speed is None or not vehicle or math.isnan(t_s):
        return Row(number_, {}, refusal=Refusal(UNAVAILABLE, "without time, id, x, y or speed"))
    return _Seen(number_, t_s, identifier(vehicle), float(x), float(y), float(speed), angle, accel)


def _time_s(text: str) -> float:
    """Read seconds, or hours, minutes and seconds apart by colons; NaN for anything else."""
    try:
        parts = [number(part) for part in text.split(":")]
    except ValueError:
        return math.nan
    if None in parts or len(parts) > 3:  # noqa: PLR2004
        return math.nan
    return float(sum(float(part or 0) * 60**place for place, part in enumerate(reversed(parts))))
