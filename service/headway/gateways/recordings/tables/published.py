"""Tables that are published or usual, each as a mapping of its columns."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from types import MappingProxyType
from typing import Final

from headway.gateways.recordings.order import in_time_order
from headway.gateways.recordings.reader import START_US, Row, Source
from headway.gateways.recordings.tables.cells import TableRow, header_of, table_rows
from headway.gateways.recordings.tables.mapping import (
    ColumnMapping,
    MappingError,
    TableReader,
    parse_mapping,
    parse_terms,
)


@dataclass(frozen=True, slots=True)
class Table:
    """A kind of table. `optional` are terms that count where the table has their columns."""

    mapping: str
    optional: str = ""
    unavailable: MappingProxyType[str, float] = field(default_factory=lambda: MappingProxyType({}))
    header: tuple[str, ...] = ()
    """Names of the columns of a file without a header."""
    is_apart: bool = False
    """Whether two files are two roads, as with local coordinates."""
    start_us: int = 0
    """Unix time of 0 in tables whose time counts from their own start."""

    def recognise(self, head: bytes) -> bool:
        """Whether these first bytes are of such a table."""
        names = header_of(head)
        return not self._required().absent(names) or self.lacks_header(names)

    def lacks_header(self, first: Sequence[str]) -> bool:
        """Whether the first line is already a row."""
        return bool(self.header) and len(first) == len(self.header) and first[0].lstrip("-").isdecimal()

    def read(self, source: Source) -> Iterator[Row]:
        """Yield the rows in the order of time; raises `RecordingError`."""
        rows = table_rows(source)
        first = next(rows, TableRow(1, ()))
        names = [str(name).strip() for name in first.cells]
        if self.lacks_header(names):
            names, rows = list(self.header), chain([first], rows)
        terms = parse_terms(self.optional)[0] if self.optional else {}
        mapping = self._required().with_optional(terms, names)
        return _records(source, mapping, names, rows, source.name if self.is_apart else "", self.start_us)

    def _required(self) -> ColumnMapping:
        return parse_mapping(self.mapping, self.unavailable)


def read_mapped(source: Source) -> Iterator[Row]:
    """Yield the rows of a table by the mapping that the user gives; raises `RecordingError`."""
    rows = table_rows(source)
    try:
        mapping = parse_mapping(source.columns or "")
    except MappingError as error:
        raise source.error(f"--columns: {error}") from None
    header = [str(name).strip() for name in next(rows, TableRow(1, ())).cells]
    return _records(source, mapping, header, rows, source.name if "x" in mapping.terms else "")


def _records(
    source: Source,
    mapping: ColumnMapping,
    header: Sequence[str],
    rows: Iterator[TableRow],
    drive: str,
    start_us: int = 0,
) -> Iterator[Row]:
    try:
        reader = TableReader(mapping, header, drive, start_us)
    except MappingError as error:
        raise source.error(error) from None
    return in_time_order(map(reader.row, rows))


BSM_P1: Final = Table(
    "id=TxDevice,drive=RxDevice+FileId,t=GenTime[us2004],lat=Latitude,lon=Longitude,speed=Speed,msg_cnt=MsgCount",
    "heading=Heading,elev=Elevation,accel=Ax",
    MappingProxyType({"lat": 90.0000001, "lon": 180.0000001, "speed": 163.82, "heading": 360.0, "accel": 20.01}),
    (
        *("RxDevice", "FileId", "TxDevice", "GenTime", "TxRandom", "MsgCount", "DSecond", "Latitude", "Longitude"),
        *("Elevation", "Speed", "Heading", "Ax", "Ay", "Az", "Yawrate", "PathCount", "RadiusOfCurve", "Confidence"),
    ),
)
"""SPMD: basic safety messages as receivers logged them; one log of one receiver is a drive."""
DATA_WSU: Final = Table(
    "id=Device+Trip,drive=Device+Trip,t=GpsTimeWsu[ms],lat=LatitudeWsu,lon=LongitudeWsu,speed=SpeedWsu[km/h]",
    "heading=GpsHeadingWsu,elev=AltitudeWsu,accel=AxWsu,valid=GpsValidWsu",
)
"""SPMD: what a car recorded of itself."""
NGSIM: Final = Table(
    "id=Vehicle_ID,t=Global_Time[ms],x=Local_X[ft],y=Local_Y[ft],speed=v_Vel[ft/s]",
    "length=v_length[ft],width=v_Width[ft],accel=v_Acc[ft/s2],drive=Location",
    is_apart=True,
)
HIGHD: Final = Table(
    "id=id,t=frame[25Hz],x=x,y=y,vx=xVelocity,vy=yVelocity,length=width,width=height",
    is_apart=True,
    start_us=START_US,
)
"""highD calls the extent along the road width; x and y are those of a corner of the box."""
WYDOT: Final = Table(
    "id=coreData_id,t=metadata_generatedAt[iso],lat=coreData_position_lat,lon=coreData_position_long,"
    "speed=coreData_speed",
    "heading=coreData_heading,msg_cnt=coreData_msgCnt",
)
GNSS: Final = Table(
    "id=id,t=t_s,lat=lat,lon=lon,speed=speed_mps",
    "heading=heading_deg,msg_cnt=msg_cnt,accuracy=accuracy_m,length=length_m,accel=accel_mps2",
    is_apart=True,
    start_us=START_US,
)
"""Drives of `headway evaluate field`: seconds from their own start."""
