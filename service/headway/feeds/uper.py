"""SAE J2735 BSM and ETSI CAM in unaligned PER, to columns in SI units.

The widths are those of the published ranges. Core data of a BSM are 290 bits behind 3 bits of options; what follows
them, part II, is skipped by the length of the frame. A CAM (EN 302 637-2, TS 103 900) is read up to the longitudinal
acceleration of its high frequency container. Signatures of IEEE 1609.2 are not checked.
"""

from collections.abc import Sequence
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.feeds import uper_kernel as kernel
from headway.feeds.kinds import BSM, J2735_NAMES
from headway.feeds.refusal import MALFORMED, OTHER_MESSAGE, OUT_OF_RANGE, UNAVAILABLE, Refusal, Result
from headway_schemas.bsm import WIRE_VERSION

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
NAMES: Final = (
    "msg_cnt", "t_us", "lat", "lon", "speed_mps", "heading_deg", "elev_m", "accel_mps2", "accuracy_m", "length_m",
    "width_m",
)  # fmt: skip
"""Columns of what is read, in the order of a compact record."""
_NEEDED: Final = ("lat", "lon", "speed_mps")
_SKIP: Final = ""


class _Field(NamedTuple):
    name: str
    """Our column, a name of its own for what is used otherwise, empty for what is skipped."""
    bits: int
    low: int = 0
    high: int = 0
    """Greatest value that is one."""
    unavailable: int | None = None
    per_unit: float = 1.0


_BSM_FIELDS: Final = (
    _Field(_SKIP, 3),  # extension, part II, regional
    _Field("msg_cnt", 7, 0, 127),
    _Field("id", 32, 0, 0xFFFF_FFFF),
    _Field("time", 16, 0, 60_999, 65_535),
    _Field("lat", 31, -900_000_000, 900_000_000, 900_000_001, 1e7),
    _Field("lon", 32, -1_799_999_999, 1_800_000_000, 1_800_000_001, 1e7),
    _Field("elev_m", 16, -4096, 61_439, -4096, 10),
    _Field("accuracy_m", 8, 0, 254, 255, 20),
    _Field(_SKIP, 8 + 16 + 3),  # semi-minor axis, orientation, transmission
    _Field("speed_mps", 13, 0, 8190, 8191, 50),
    _Field("heading_deg", 15, 0, 28_799, 28_800, 80),
    _Field(_SKIP, 8),  # steering wheel angle
    _Field("accel_mps2", 12, -2000, 2000, 2001, 100),
    _Field(_SKIP, 12 + 8 + 16 + 15),  # other accelerations, yaw rate, brakes
    _Field("width_m", 10, 0, 1023, 0, 100),
    _Field("length_m", 12, 0, 4095, 0, 100),
)
_CAM_FIELDS: Final = (
    _Field(_SKIP, 8 + 8),  # protocol version, message id
    _Field("id", 32, 0, 0xFFFF_FFFF),
    _Field("time", 16, 0, 65_535),
    _Field(_SKIP, 3 + 1 + 8),  # options, station type
    _Field("lat", 31, -900_000_000, 900_000_000, 900_000_001, 1e7),
    _Field("lon", 32, -1_800_000_000, 1_800_000_000, 1_800_000_001, 1e7),
    _Field("accuracy_m", 12, 0, 4094, 4095, 100),
    _Field(_SKIP, 12 + 12),
    _Field("elev_m", 20, -100_000, 800_000, 800_001, 100),
    _Field(_SKIP, 4 + 2 + 7),  # confidence, choice of the container, its options
    _Field("heading_deg", 12, 0, 3600, 3601, 10),
    _Field(_SKIP, 7),
    _Field("speed_mps", 14, 0, 16_380, 16_383, 100),
    _Field(_SKIP, 7 + 2),
    _Field("length_m", 10, 1, 1022, 1023, 10),
    _Field(_SKIP, 3),
    _Field("width_m", 6, 1, 61, 62, 10),
    _Field("accel_mps2", 9, -160, 160, 161, 10),
)
CAM_SIGMAS: Final = 2.447746830680816
"""sqrt(-2 ln 0.05): the ellipse of 95 % in standard deviations of one axis, which a CAM gives (TS 102 894-2)."""
_MINUTE_US, CAM_PERIOD_US = 60_000_000, 65_536_000
ITS_EPOCH_US: Final = 1_072_915_200_000_000 - 5_000_000
"""2004-01-01 in Unix time, less the leap seconds since: TimestampIts counts them, Unix time does not."""
_ACCURACY_MAX_M, _ELEVATION_M, _LENGTH_MAX_M = 12.7, (-409.5, 6143.9), 40.95


class _Table(NamedTuple):
    fields: tuple[_Field, ...]
    places: I64
    """(K, 3) first bit, width, least value."""

    @property
    def names(self) -> list[str]:
        return [field.name for field in self.fields]


def _table(fields: Sequence[_Field]) -> _Table:
    firsts = np.cumsum([0, *(field.bits for field in fields)])
    used = [(field, int(first)) for field, first in zip(fields, firsts, strict=False) if field.name]
    places = np.array([(first, field.bits, field.low) for field, first in used], np.int64)
    return _Table(tuple(field for field, _ in used), places)


_BSM, _CAM = _table(_BSM_FIELDS), _table(_CAM_FIELDS)


class UperRecords(NamedTuple):
    """B frames as columns; where `refusals` has the place of one, its values have no meaning."""

    ids: NDArray[np.bytes_]
    """(B,) eight hex digits of a BSM, the station id of a CAM in decimal."""
    numbers: dict[str, F64]
    """(B,) by `NAMES`, NaN where unavailable."""
    refusals: dict[int, Refusal]


def read_bsms(frames: Sequence[bytes], reference_us: I64) -> UperRecords:
    """Read a BSM in each frame; its minute is the one nearest to `reference_us` (B,).

    A frame is a MessageFrame, also behind IEEE 1609.3 and 1609.2 headers or others, as octets or as hex text.
    """
    raw, status, detail = _read(kernel.read_bsm, _BSM, frames)
    refusals = _refusals(_BSM, raw, status, detail, _BSM_MESSAGES)
    refusals |= _others(frames, status, _Other(kernel.read_cam, _CAM, A_CAM, _ITS_MESSAGES))
    numbers = _si(_BSM, raw)
    sec_mark = raw[_BSM.names.index("time")]
    for i in np.flatnonzero((sec_mark == 65_535) & (status == kernel.READ)).tolist():  # noqa: PLR2004 - unavailable
        refusals[i] = Refusal(UNAVAILABLE, "secMark is unavailable")
    numbers["t_us"] = _nearest_us(sec_mark * 1000, _MINUTE_US, reference_us)
    octets = raw[_BSM.names.index("id")].astype(">u4").view(np.uint8)
    digits = np.frombuffer(b"0123456789ABCDEF", np.uint8)[np.stack([octets >> 4, octets & 15], axis=1)]
    return UperRecords(np.ascontiguousarray(digits).reshape(-1).view("S8"), numbers, refusals)


def read_cams(frames: Sequence[bytes], reference_us: I64) -> UperRecords:
    """Read a CAM in each frame; its time is the one nearest to `reference_us` (B,) modulo 65,536 ms.

    A frame is a CAM, also behind GeoNetworking and BTP-B headers, as octets or as hex text.
    """
    raw, status, detail = _read(kernel.read_cam, _CAM, frames)
    refusals = _refusals(_CAM, raw, status, detail, _ITS_MESSAGES)
    refusals |= _others(frames, status, _Other(kernel.read_bsm, _BSM, _A_BSM, _BSM_MESSAGES))
    numbers = _si(_CAM, raw)
    delta_us = raw[_CAM.names.index("time")] * 1000
    numbers["t_us"] = _nearest_us(delta_us + ITS_EPOCH_US, CAM_PERIOD_US, reference_us)
    numbers["msg_cnt"] = np.zeros(len(frames))
    numbers["heading_deg"] %= 360.0
    numbers["accuracy_m"] = np.minimum(numbers["accuracy_m"] / CAM_SIGMAS, _ACCURACY_MAX_M)
    low, high = _ELEVATION_M
    numbers["elev_m"][~((numbers["elev_m"] >= low) & (numbers["elev_m"] <= high))] = np.nan
    numbers["length_m"][numbers["length_m"] > _LENGTH_MAX_M] = np.nan
    return UperRecords(raw[_CAM.names.index("id")].astype("S10"), numbers, refusals)


def bsm_record(text: str, reference_us: int) -> Result:
    """Return the compact record of a BSM in hex digits."""
    return _record(read_bsms([text.encode("ascii", "replace")], np.array([reference_us])))


def cam_record(text: str, reference_us: int) -> Result:
    """Return the compact record of a CAM in hex digits."""
    return _record(read_cams([text.encode("ascii", "replace")], np.array([reference_us])))


def _record(read: UperRecords) -> Result:
    if read.refusals:
        return read.refusals[0]
    values = [float(read.numbers[name][0]) for name in NAMES]
    msg_cnt, t_us, *rest = (None if value != value else value for value in values)  # noqa: PLR0124 - NaN
    return [WIRE_VERSION, read.ids[0].decode(), int(msg_cnt or 0), int(t_us or 0), *rest]


def _read(read: Any, table: _Table, frames: Sequence[bytes]) -> tuple[I64, I64, I64]:
    raw = np.zeros((len(table.fields), len(frames)), np.int64)
    status, detail = np.zeros(len(frames), np.int64), np.zeros(len(frames), np.int64)
    if frames:
        read(*kernel.as_bytes(frames), table.places, raw, status, detail)
    return raw, status, detail


def _si(table: _Table, raw: I64) -> dict[str, F64]:
    numbers: dict[str, F64] = {}
    for field, column in zip(table.fields, raw, strict=True):
        if field.name in NAMES:
            numbers[field.name] = column / field.per_unit
            if field.unavailable is not None:
                numbers[field.name][column == field.unavailable] = np.nan
    return numbers


def _nearest_us(offset_us: I64, period_us: int, reference_us: I64) -> F64:
    age_us = (reference_us - offset_us) % period_us
    t_us: F64 = (reference_us - np.where(age_us <= period_us // 2, age_us, age_us - period_us)).astype(np.float64)
    return t_us


_BSM_MESSAGES: Final = {number: f"a {name}, no {BSM}" for name, number in J2735_NAMES.items()}
_ITS_MESSAGES: Final = {1: "a DENM, no CAM", 2: "a CAM of a roadside unit", 4: "a SPATEM, no CAM", 5: "a MAPEM, no CAM"}
_STATUS: Final = {
    kernel.NOT_FOUND: Refusal(MALFORMED, "no message found in these octets"),
    kernel.FRAGMENTED: Refusal(MALFORMED, "a fragmented length, which a message of one packet cannot have"),
    kernel.ENCRYPTED: Refusal(OTHER_MESSAGE, "IEEE 1609.2 content that is encrypted or a certificate request"),
    kernel.CUT: Refusal(MALFORMED, "the message is cut"),
}


A_CAM: Final = Refusal(OTHER_MESSAGE, "a CAM: the encoding application/cam;uper reads it")
_A_BSM: Final = Refusal(OTHER_MESSAGE, f"a {BSM}: the encoding application/j2735;uper reads it")
_JSON: Final = Refusal(MALFORMED, "JSON, neither octets of PER nor their hex digits")


class _Other(NamedTuple):
    """What a frame may be instead: how that is read and named."""

    read: Any
    table: _Table
    itself: Refusal
    names: dict[int, str]


def _others(frames: Sequence[bytes], status: I64, other: _Other) -> dict[int, Refusal]:
    """Name the frames in which no message was found but that are another message, or JSON."""
    places = np.flatnonzero(status == kernel.NOT_FOUND).tolist()
    _, found, detail = _read(other.read, other.table, [frames[i] for i in places])
    refusals: dict[int, Refusal] = {}
    for i, what, number in zip(places, found.tolist(), detail.tolist(), strict=True):
        if what == kernel.READ:
            refusals[i] = other.itself
        elif what == kernel.OTHER and number in other.names:
            refusals[i] = Refusal(OTHER_MESSAGE, other.names[number])
        elif frames[i].lstrip()[:1] in (b"{", b"["):
            refusals[i] = _JSON
    return refusals


def _refusals(table: _Table, raw: I64, status: I64, detail: I64, names: dict[int, str]) -> dict[int, Refusal]:
    """Name what is wrong: by the search for the frame, else by the first field that is no value."""
    refusals: dict[int, Refusal] = {}
    for i in np.flatnonzero(status != kernel.READ).tolist():
        other = Refusal(OTHER_MESSAGE, names.get(int(detail[i]), "another type of message"))
        refusals[i] = _STATUS.get(int(status[i]), other)
    for field, column in zip(table.fields, raw, strict=True):
        outside = (column > field.high) | (column < field.low)
        if field.unavailable is not None:
            is_unavailable = column == field.unavailable
            outside &= ~is_unavailable
            if field.name in _NEEDED:
                for i in np.flatnonzero(is_unavailable & (status == kernel.READ)).tolist():
                    refusals.setdefault(i, Refusal(UNAVAILABLE, f"{field.name} is unavailable"))
        for i in np.flatnonzero(outside & (status == kernel.READ)).tolist():
            refusals.setdefault(i, Refusal(OUT_OF_RANGE, f"{field.name}: a reserved value"))
    return refusals
