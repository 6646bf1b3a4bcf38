"""Any table by a mapping of its columns: `id=vehID,t=time[ms],lat=Latitude,lon=Longitude,speed=v[mph]`.

A term is `FIELD=COLUMN[UNIT]`; the unit may be left out. Several columns joined by `+` make one `id` or `drive`. Names
of columns are found in any case. Positions are `lat,lon`, or metres `x` (east) and `y` (north) from `origin=LAT/LON`.
Motion is `speed` and `heading`, or the velocities `vx` and `vy` on the same axes.
"""

import math
import re
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from fractions import Fraction
from types import MappingProxyType
from typing import Any, Final, NamedTuple

from headway.feeds.instants import instant_us
from headway.feeds.refusal import MALFORMED, UNAVAILABLE, Refusal
from headway.gateways.recordings.local_plane import ORIGIN, Origin, course_deg
from headway.gateways.recordings.reader import Record, Row
from headway.gateways.recordings.tables.cells import CUT_ROW, TableRow, identifier, number
from headway_schemas.bsm import WIRE_VERSION
from headway_schemas.fields import T_US_MAX

NEEDED: Final = ("id", "t")
_READINGS: Final = ("t", "lat", "lon", "x", "y", "speed", "vx", "vy")
"""Without a value of one of these that is mapped, there is no record."""
_TEXT: Final = ("id", "drive")
_SIDE_LIMITS: Final = {
    "elev": (-409.5, 6143.9), "accel": (-20.0, 20.0), "accuracy": (0.0, 12.7), "length": (1e-9, 40.95),
    "width": (1e-9, 10.23),
}  # fmt: skip
"""Optional values beyond what BSM v1 can carry are left out; the readings themselves never are."""
_FIELDS: Final = (
    *("id", "t", "lat", "lon", "x", "y", "speed", "vx", "vy", "heading", "msg_cnt", "received", "drive", "valid"),
    *_SIDE_LIMITS,
)
_METRES: Final = {"": 1.0, "m": 1.0, "ft": 0.3048, "cm": 0.01, "km": 1000.0}
_SPEEDS: Final = {"": 1.0, "m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "kn": 1852 / 3600, "ft/s": 0.3048}
_DEGREES: Final = {"": 1.0, "deg": 1.0, "rad": math.degrees(1.0), "1e-7deg": 1e-7}
_ACCELERATIONS: Final = {"": 1.0, "m/s2": 1.0, "ft/s2": 0.3048, "g": 9.80665}
_HEADINGS: Final = (*_DEGREES, "deg math", "rad math")
_ISO: Final = "iso"
_EPOCHS_US: Final = {"2004": 1_072_915_200_000_000}
"""2004-01-01 in Unix time; written behind the unit, as in `us2004`."""
_TIMES: Final = {
    **dict.fromkeys(("", "s"), Fraction(1_000_000)),
    "ms": Fraction(1000),
    "cs": Fraction(10_000),
    "us": Fraction(1),
    "ns": Fraction(1, 1000),
}
_UNITS: Final[dict[str, Mapping[str, float]]] = {
    **dict.fromkeys(("lat", "lon"), _DEGREES),
    **dict.fromkeys(("x", "y", "elev", "accuracy", "length", "width"), _METRES),
    **dict.fromkeys(("speed", "vx", "vy"), _SPEEDS),
    "accel": _ACCELERATIONS,
    "msg_cnt": {"": 1.0},
    "valid": {"": 1.0},
}
_PART: Final = re.compile(r'(?:"[^"]*"|[^,])+')
_TERM: Final = re.compile(r'\s*(\w+)\s*=\s*("[^"]*"|[^\[\]"]*?)\s*(?:\[([^\[\]]*)\])?\s*')
_COUNTED_MAX: Final = 100_000
_US_PER_S: Final = 1_000_000
_MSG_CNT_MASK: Final = 127


class MappingError(ValueError):
    """A mapping that cannot be used: one line."""


class Term(NamedTuple):
    """Where the value of a field is."""

    columns: tuple[str, ...]
    unit: str


@dataclass(frozen=True, slots=True)
class ColumnMapping:
    """What the columns of a table mean.

    `unavailable` holds, in the units of the table, the value of a field from which on it stands for unavailable.
    """

    terms: Mapping[str, Term]
    origin: Origin = ORIGIN
    unavailable: Mapping[str, float] = field(default_factory=lambda: MappingProxyType({}))

    def absent(self, header: Sequence[str]) -> list[str]:
        """Return the columns that the table lacks."""
        names = {name.lower() for name in header}
        return [c for term in self.terms.values() for c in term.columns if c.lower() not in names]

    def with_optional(self, others: "Mapping[str, Term]", header: Sequence[str]) -> "ColumnMapping":
        """Return the mapping with those of the other terms whose columns the table has."""
        there = {name: term for name, term in others.items() if not ColumnMapping({name: term}).absent(header)}
        return replace(self, terms=MappingProxyType({**self.terms, **there}))


def parse_mapping(text: str, unavailable: Mapping[str, float] = MappingProxyType({})) -> ColumnMapping:
    """Read a mapping.

    Raises
    ------
    MappingError
        A term is not of its form, a field or unit is unknown, or a field that a record needs is missing.
    """
    terms, origin = parse_terms(text)
    _require_fields(terms)
    return ColumnMapping(MappingProxyType(terms), origin, unavailable)


def parse_terms(text: str) -> tuple[dict[str, Term], Origin]:
    """Read the terms of a mapping, whatever fields they give. Raises `MappingError`."""
    terms: dict[str, Term] = {}
    origin = ORIGIN
    for part in _PART.findall(text) or [text]:
        found = _TERM.fullmatch(part)
        if found is None or not found[2]:
            raise MappingError(f"{part.strip()!r}: write FIELD=COLUMN[UNIT]")
        name, column, unit = found[1], found[2], (found[3] or "").strip()
        if name == "origin":
            origin = _origin(column)
            continue
        if name not in _FIELDS:
            raise MappingError(f"no field {name}: choose from {', '.join((*_FIELDS, 'origin'))}")
        if name in terms:
            raise MappingError(f"{name} twice")
        _require_unit(name, unit)
        quoted = column.startswith('"')
        columns = tuple(map(str.strip, column.split("+"))) if name in _TEXT and not quoted else (column.strip('"'),)
        terms[name] = Term(columns, unit)
    return terms, origin


def _origin(text: str) -> Origin:
    try:
        lat, lon = map(float, text.split("/"))
    except ValueError:
        raise MappingError(f"origin={text}: write origin=LAT/LON in degrees") from None
    if not (-89.0 <= lat <= 89.0 and -180.0 <= lon <= 180.0):  # noqa: PLR2004 - a pole has no east
        raise MappingError(f"origin={text}: no place on the earth that has an east")
    return Origin(lat, lon)


def _require_unit(name: str, unit: str) -> None:
    if name in ("t", "received"):
        known = _time_unit(unit) is not None or unit == _ISO
        units: Sequence[str] = ("s", "ms", "cs", "us", "ns", "us2004", "iso", "25Hz")
    elif name == "heading":
        units, known = _HEADINGS, unit in _HEADINGS
    else:
        units = tuple(_UNITS.get(name, {"": 1.0}))
        known = unit in units
    if not known:
        raise MappingError(f"{name}: no unit {unit}: choose from {', '.join(filter(None, units)) or 'none'}")


def _require_fields(terms: Mapping[str, Term]) -> None:
    missing = [name for name in NEEDED if name not in terms]
    if not ({"lat", "lon"} <= terms.keys() or {"x", "y"} <= terms.keys()):
        missing.append("lat and lon, or x and y")
    if not ("speed" in terms or {"vx", "vy"} <= terms.keys()):
        missing.append("speed, or vx and vy")
    if missing:
        raise MappingError(f"missing: {', '.join(missing)}")


def _time_unit(unit: str) -> tuple[Fraction, int] | None:
    """Return microseconds in a unit, and its epoch in Unix time; None for no unit of time."""
    epoch = next((name for name in _EPOCHS_US if unit.endswith(name)), "")
    base = unit.removesuffix(epoch) if epoch else unit
    if base in _TIMES:
        return _TIMES[base], _EPOCHS_US.get(epoch, 0)
    rate = re.fullmatch(r"(\d{1,6})Hz", base)
    return (Fraction(_US_PER_S, int(rate[1])), _EPOCHS_US.get(epoch, 0)) if rate and int(rate[1]) else None


class _CellError(ValueError):
    def __init__(self, refusal: Refusal) -> None:
        super().__init__(refusal.detail)
        self.refusal = refusal


@dataclass(frozen=True, slots=True)
class _Cell:
    """A field in a table: its place in the row and how it is read."""

    place: int
    column: str
    kind: str
    """What a cell must hold, in words."""
    convert: Callable[[Any], Any]

    def value(self, cells: Sequence[Any]) -> Any:
        try:
            return self.convert(cells[self.place])
        except (ValueError, OverflowError):
            raise _CellError(Refusal(MALFORMED, f"column {self.column}: not {self.kind}")) from None


class TableReader:
    """Turns the rows of one table into records.

    Raises
    ------
    MappingError
        The table lacks a column of the mapping.
    """

    def __init__(self, mapping: ColumnMapping, header: Sequence[str], drive: str = "", start_us: int = 0) -> None:
        places = {name.strip().lower(): place for place, name in reversed(list(enumerate(header)))}
        if absent := mapping.absent([name.strip() for name in header]):
            raise MappingError(f"no column {', '.join(absent)}: the table has {', '.join(filter(None, header))[:300]}")
        self._width = len(header) - (bool(header) and not header[-1].strip())
        self._texts = {
            name: [places[column.lower()] for column in mapping.terms[name].columns]
            for name in _TEXT
            if name in mapping.terms
        }
        self._cells = {
            name: _Cell(
                places[term.columns[0].lower()],
                term.columns[0],
                _kind(name, term.unit),
                _converter(name, term.unit, mapping),
            )
            for name, term in mapping.terms.items()
            if name not in _TEXT
        }
        self._needed = [name for name in _READINGS if name in self._cells]
        self._origin = mapping.origin
        self._drive = drive
        self._start_us = start_us
        self._counts: OrderedDict[tuple[str, str], int] = OrderedDict()

    def row(self, row: TableRow) -> Row:
        """Return the record of a row, or why there is none."""
        if len(row.cells) < self._width:
            return Row(row.number, {}, self._drive, Refusal(MALFORMED, CUT_ROW))
        try:
            return self._row(row)
        except _CellError as error:
            return Row(row.number, {}, self._drive, error.refusal)
        except (ValueError, OverflowError):
            return Row(row.number, {}, self._drive, Refusal(MALFORMED, "a number that is no place or motion"))

    def _row(self, row: TableRow) -> Row:
        values = {name: cell.value(row.cells) for name, cell in self._cells.items()}
        for name in self._needed:
            if values[name] is None:
                raise _CellError(Refusal(UNAVAILABLE, f"column {self._cells[name].column}: no value"))
        if values.get("valid") == 0:
            raise _CellError(Refusal(UNAVAILABLE, f"column {self._cells['valid'].column}: marked as not valid"))
        vehicle = self._text("id", row.cells)
        if not vehicle:
            raise _CellError(Refusal(UNAVAILABLE, "no id"))
        drive = f"{self._drive}{self._text('drive', row.cells)}"
        record = self._record(vehicle, drive, values)
        return Row(row.number, record, drive)

    def _record(self, vehicle: str, drive: str, values: dict[str, Any]) -> Record:
        lat, lon = values.get("lat"), values.get("lon")
        if lat is None or lon is None:
            lat, lon = self._origin.lat_lon(values["x"], values["y"])
        speed_mps, heading_deg = values.get("speed"), values.get("heading")
        if "vx" in values:
            heading_deg = course_deg(values["vx"], values["vy"]) if heading_deg is None else heading_deg
            speed_mps = math.hypot(values["vx"], values["vy"]) if speed_mps is None else speed_mps
        msg_cnt = values.get("msg_cnt")
        record: Record = {
            "v": WIRE_VERSION,
            "id": vehicle,
            "msg_cnt": self._count(drive, vehicle) if msg_cnt is None else _whole(msg_cnt),
            "t_us": self._start_us + values["t"],
            "lat": lat,
            "lon": lon,
            "speed_mps": speed_mps,
        }
        if heading_deg is not None:
            record["heading_deg"] = heading_deg
        for name, (low, high) in _SIDE_LIMITS.items():
            value = values.get(name)
            if value is not None and low <= value <= high:
                record[_WIRE[name]] = value
        if values.get("received") is not None:
            record["received_us"] = self._start_us + values["received"]
        return record

    def _text(self, name: str, cells: Sequence[Any]) -> str:
        texts = [_text_of(cells[place]) for place in self._texts.get(name, ())]
        return identifier("-".join(texts)) if any(texts) else ""

    def _count(self, drive: str, vehicle: str) -> int:
        """Return the number of a message in a table that does not count them."""
        key = (drive, vehicle)
        count = self._counts.pop(key, 0)
        self._counts[key] = count + 1
        if len(self._counts) > _COUNTED_MAX:
            self._counts.popitem(last=False)
        return count & _MSG_CNT_MASK


_WIRE: Final = {
    "elev": "elev_m", "accel": "accel_mps2", "accuracy": "accuracy_m", "length": "length_m", "width": "width_m",
}  # fmt: skip


def _text_of(cell: Any) -> str:
    text = "" if cell is None else str(cell).strip()
    return "" if text in ("\\N", "NULL") else text.removesuffix(".0") if isinstance(cell, float) else text


def _whole(value: float) -> Any:
    return int(value) if float(value).is_integer() else value


def _kind(name: str, unit: str) -> str:
    if name in ("t", "received"):
        return "a time of ISO 8601" if unit == _ISO else f"a time in {unit or 's'}"
    return "a number"


def _converter(name: str, unit: str, mapping: ColumnMapping) -> Callable[[Any], Any]:
    if name in ("t", "received"):
        return _time_us if unit == _ISO else _timer(unit)
    if name == "heading":
        return _heading(unit, mapping.unavailable.get(name))
    factor, missing = _UNITS[name][unit], mapping.unavailable.get(name)

    def convert(cell: Any) -> float | None:
        value = number(cell)
        if value is None or (missing is not None and value >= missing):
            return None
        return value if factor == 1.0 else value * factor

    return convert


def _timer(unit: str) -> Callable[[Any], int | None]:
    of_unit = _time_unit(unit)
    assert of_unit is not None
    scale, epoch_us = of_unit

    def convert(cell: Any) -> int | None:
        value = number(cell)
        if value is None:
            return None
        # A table with more than microseconds is exact: Unix time in nanoseconds does not fit a double.
        us = value * scale.numerator // scale.denominator if isinstance(value, int) else round(value * float(scale))
        if epoch_us + us > T_US_MAX:
            raise ValueError(us)
        return epoch_us + us

    return convert


def _time_us(cell: Any) -> int | None:
    """Read ISO 8601; without a zone it is UTC."""
    if cell is None or isinstance(cell, datetime):
        text = None if cell is None else (cell if cell.tzinfo else cell.replace(tzinfo=UTC)).isoformat()
    else:
        text = str(cell).strip()
    if not text:
        return None
    us = instant_us(text)
    us = instant_us(f"{text}+00:00") if us is None else us
    if us is None:
        raise ValueError(text)
    return us


def _heading(unit: str, missing: float | None) -> Callable[[Any], float | None]:
    base, _, kind = unit.partition(" ")
    factor = _DEGREES[base]

    def convert(cell: Any) -> float | None:
        value = number(cell)
        if value is None or (missing is not None and value >= missing):
            return None
        degrees = value * factor
        return (90.0 - degrees if kind else degrees) % 360.0

    return convert
