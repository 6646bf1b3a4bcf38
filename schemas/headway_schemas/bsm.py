"""Basic safety message, version 1: what vehicles send.

SI units, event time, null for unavailable. The ranges are those of SAE J2735 part I less its sentinels, so a sender
that converts a sentinel as if it were a value is out of range. On the wire a message is a map of these fields or a
compact record, the array of their values in declared order with trailing nulls cut; a payload holds one message or
a bundle, an array of them.
"""

from collections.abc import Sequence
from typing import Annotated, Any, Final, Self

from pydantic import Field, model_validator
from pydantic.fields import FieldInfo

from headway_schemas.fields import Id, Message, TUs

WIRE_VERSION: Final = 1


def _si(
    unit: str, *, ge: float | None = None, gt: float | None = None, le: float | None = None, lt: float | None = None
) -> FieldInfo:
    info: FieldInfo = Field(ge=ge, gt=gt, le=le, lt=lt, allow_inf_nan=False, json_schema_extra={"unit": unit})
    return info


Version = Annotated[int, Field(ge=WIRE_VERSION, le=WIRE_VERSION, json_schema_extra={"const": WIRE_VERSION})]
Speed = Annotated[float, _si("m/s", ge=0.0, le=163.8)]
Latitude = Annotated[float, _si("deg", ge=-90.0, le=90.0)]
Longitude = Annotated[float, _si("deg", ge=-180.0, le=180.0)]
Heading = Annotated[float, _si("deg", ge=0.0, lt=360.0)]
Elevation = Annotated[float, _si("m", ge=-409.5, le=6143.9)]
Acceleration = Annotated[float, _si("m/s2", ge=-20.0, le=20.0)]
Accuracy = Annotated[float, _si("m", ge=0.0, le=12.7)]
Length = Annotated[float, _si("m", gt=0.0, le=40.95)]
Width = Annotated[float, _si("m", gt=0.0, le=10.23)]
Range = Annotated[float, _si("m", ge=0.0, le=1000.0)]
RangeRate = Annotated[float, _si("m/s", ge=-327.6, le=327.6)]


class Leader(Message):
    """The vehicle ahead, as the sender's own forward sensor sees it."""

    id: Id
    range_m: Range | None = None
    """From the sender's reference point to the leader."""
    range_rate_mps: RangeRate | None = None
    """How fast the distance grows: negative while closing in."""


class Bsm(Message):
    """One basic safety message, version 1."""

    v: Version
    id: Id
    msg_cnt: Annotated[int, Field(ge=0, le=127)]
    """Counts up by one with each message of the sender and wraps after 127."""
    t_us: TUs
    """When the sender took the readings, not when it sent them."""
    lat: Latitude
    lon: Longitude
    speed_mps: Speed
    heading_deg: Heading | None = None
    """Clockwise from true north."""
    elev_m: Elevation | None = None
    accel_mps2: Acceleration | None = None
    """Along the vehicle."""
    accuracy_m: Accuracy | None = None
    """One sigma of the position; 12.7 stands for 12.7 or more."""
    length_m: Length | None = None
    width_m: Width | None = None
    leader: Leader | None = None

    @model_validator(mode="after")
    def _leads_another(self) -> Self:
        if self.leader is not None and self.leader.id == self.id:
            raise ValueError("a vehicle cannot be its own leader")
        return self


FIELDS: Final = tuple(Bsm.model_fields)
"""Names of the fields in the order of the compact record."""
LEADER_FIELDS: Final = tuple(Leader.model_fields)
NEEDED: Final = tuple(name for name, field in Bsm.model_fields.items() if field.is_required())
"""Fields that must not be null."""


def to_map(bsm: Bsm) -> dict[str, Any]:
    """Return the message as a map, without the fields that are null."""
    return bsm.model_dump(exclude_none=True)


def to_record(bsm: Bsm) -> list[Any]:
    """Return the message as a compact record, trailing nulls cut."""
    record = [getattr(bsm, name) for name in FIELDS]
    if bsm.leader is not None:
        record[-1] = _cut([getattr(bsm.leader, name) for name in LEADER_FIELDS])
    return _cut(record)


def from_map(fields: dict[str, Any]) -> Bsm:
    """Read a map; a field that is absent is null. Raises `pydantic.ValidationError`."""
    return Bsm.model_validate(fields)


def from_record(record: Sequence[Any]) -> Bsm:
    """Read a compact record.

    Raises
    ------
    pydantic.ValidationError
        A field is not what the model allows.
    ValueError
        The record or its leader has too many fields, or the leader is no array.
    """
    fields = _named(FIELDS, record)
    leader = fields.get("leader")
    if leader is not None:
        fields["leader"] = _named(LEADER_FIELDS, leader)
    return Bsm.model_validate(fields)


def _cut(record: list[Any]) -> list[Any]:
    while record and record[-1] is None:
        record.pop()
    return record


def _named(names: tuple[str, ...], values: Sequence[Any]) -> dict[str, Any]:
    if not isinstance(values, list | tuple):
        raise ValueError(f"{type(values).__name__} where an array is meant")  # noqa: TRY004
    if len(values) > len(names):
        raise ValueError(f"{len(values)} fields where {len(names)} are the most")
    return dict(zip(names, values, strict=False))
