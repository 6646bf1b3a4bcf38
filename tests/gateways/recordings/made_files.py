"""Two cars behind one another, written in every format that is read, and what each row holds."""

import json
import math
import struct
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import polars as pl

from headway.gateways.recordings.local_plane import ORIGIN
from headway.gateways.recordings.reader import START_US

STEPS: Final = 60
ABSOLUTE_US: Final = 1_700_000_000_000_000
_GAP_M: Final = 30.0


@dataclass(frozen=True, slots=True)
class Reading:
    """What a car reads in a step. It drives straight north from the origin of local coordinates."""

    car: int
    step: int
    start_us: int = ABSOLUTE_US

    @property
    def t_us(self) -> int:
        """Unix time, for formats that say it."""
        return self.start_us + self.step * 100_000

    @property
    def t_s(self) -> float:
        return self.step / 10

    @property
    def speed_mps(self) -> float:
        return 12.0 + 0.02 * self.step

    @property
    def y_m(self) -> float:
        return 12.0 * self.t_s + 0.1 * self.t_s**2 - _GAP_M * self.car

    @property
    def lat(self) -> float:
        return ORIGIN.lat_lon(0.0, self.y_m)[0]

    @property
    def lon(self) -> float:
        return ORIGIN.lon


READINGS: Final = [Reading(car, step) for step in range(STEPS) for car in (1, 2)]


def _csv(header: str, row: Callable[[Reading], str]) -> Callable[[Path], None]:
    return lambda path: path.write_text("\n".join([header, *map(row, READINGS)]) + "\n") and None


def _lines(row: Callable[[Reading], object]) -> Callable[[Path], None]:
    return lambda path: path.write_text("".join(json.dumps(row(one)) + "\n" for one in READINGS)) and None


BSM_P1_HEADER: Final = (
    "RxDevice,FileId,TxDevice,GenTime,TxRandom,MsgCount,DSecond,Latitude,Longitude,Elevation,Speed,Heading,"
    "Ax,Ay,Az,Yawrate,PathCount,RadiusOfCurve,Confidence"
)


def bsm_p1_row(one: Reading, *, receiver: int = 17, us: int = ABSOLUTE_US) -> str:
    since_2004 = us - 1_072_915_200_000_000 + one.step * 100_000
    return (
        f"{receiver},9,{one.car},{since_2004},0,{one.step % 128},0,{one.lat:.9f},{one.lon:.7f},250,"
        f"{one.speed_mps:.2f},0.0,0.1,20.01,0,0,3,3276.7,100"
    )


def ode_message(one: Reading) -> dict[str, object]:
    ms = one.t_us // 1000 % 60_000
    minute_s = one.t_us // 60_000_000 * 60
    core = {
        "msgCnt": one.step % 128,
        "id": f"{one.car:08X}",
        "secMark": ms,
        "position": {"latitude": one.lat, "longitude": one.lon},
        "speed": one.speed_mps,
        "heading": 0.0,
    }
    generated = pl.select(pl.from_epoch(pl.lit(minute_s + ms // 1000), "s")).item().isoformat()
    return {"metadata": {"recordGeneratedAt": f"{generated}Z"}, "payload": {"data": {"coreData": core}}}


def raw_core(one: Reading) -> dict[str, int | str]:
    ms = one.t_us // 1000 % 60_000
    return {
        "msgCnt": one.step % 128, "id": f"{one.car:08X}", "secMark": ms, "lat": round(one.lat * 1e7),
        "long": round(one.lon * 1e7), "speed": round(one.speed_mps * 50), "heading": 0,
    }  # fmt: skip


def _thea(path: Path) -> None:
    lines = []
    for one in READINGS:
        core = "".join(f"<{name}>{value}</{name}>" for name, value in raw_core(one).items())
        frame = f"<BasicSafetyMessage><coreData>{core}</coreData></BasicSafetyMessage>"
        xer = f"<MessageFrame><messageId>20</messageId><value>{frame}</value></MessageFrame>"
        lines.append(f"{one.t_us // 1000 + 20}, in, 32,{xer}\n")
    path.write_text("".join(lines))


def uper(one: Reading) -> bytes:
    """Pack the core data of a BSM by the published widths, in a MessageFrame."""
    core = raw_core(one)
    fields = [
        (0, 3), (int(core["msgCnt"]), 7), (one.car, 32), (int(core["secMark"]), 16),
        (int(core["lat"]) + 900_000_000, 31), (int(core["long"]) + 1_799_999_999, 32), (0, 16), (255, 8), (255, 8),
        (65535, 16), (7, 3), (int(core["speed"]), 13), (0, 15), (127, 8), (4001, 12), (4001, 12), (0, 8), (32767, 16),
        (0, 15), (0, 10), (0, 12),
    ]  # fmt: skip
    bits = "".join(f"{value:0{width}b}" for value, width in fields)
    octets = int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")
    return b"\x00\x14" + bytes([len(octets)]) + octets


def _datagram(payload: bytes) -> bytes:
    udp = struct.pack(">HHHH", 1516, 1516, 8 + len(payload), 0) + payload
    ip = struct.pack(">BBHHHBBH4s4s", 0x45, 0, 20 + len(udp), 0, 0, 64, 17, 0, b"\x7f\0\0\1", b"\x7f\0\0\1")
    return b"\0" * 12 + b"\x08\x00" + ip + udp


def pcap(path: Path, frame: Callable[[Reading], bytes] = uper, readings: Sequence[Reading] = READINGS) -> None:
    """Write the frames as captured datagrams, each 20 ms after its event time."""
    with path.open("wb") as file:
        file.write(struct.pack("<IHHiIII", 0xA1B2C3D4, 2, 4, 0, 0, 65535, 1))
        for one in readings:
            us, packet = one.t_us + 20_000, _datagram(frame(one))
            file.write(struct.pack("<IIII", us // 10**6, us % 10**6, len(packet), len(packet)) + packet)


def _pcapng(path: Path) -> None:
    def block(kind: int, body: bytes) -> bytes:
        body += b"\0" * (-len(body) % 4)
        return struct.pack(">II", kind, len(body) + 12) + body + struct.pack(">I", len(body) + 12)

    with path.open("wb") as file:
        file.write(block(0x0A0D0D0A, struct.pack(">IHHq", 0x1A2B3C4D, 1, 0, -1)))
        file.write(block(1, struct.pack(">HHI", 1, 0, 0) + struct.pack(">HHBxxxHH", 9, 1, 9, 0, 0)))
        for one in READINGS:
            ns, packet = 1000 * (one.t_us + 20_000), _datagram(uper(one))
            file.write(
                block(6, struct.pack(">IIIII", 0, ns >> 32, ns & 0xFFFF_FFFF, len(packet), len(packet)) + packet)
            )


def cam_delta(one: Reading) -> int:
    """Return the milliseconds of TAI since 2004, modulo 65,536."""
    return ((one.t_us - 1_072_915_200_000_000) // 1000 + 5000) % 65_536


def vanetza_message(one: Reading) -> dict[str, object]:
    fast = {"heading": {"headingValue": 0.0}, "speed": {"speedValue": float(one.speed_mps)}}
    parameters = {
        "basicContainer": {"referencePosition": {"latitude": one.lat, "longitude": one.lon}},
        "highFrequencyContainer": {"basicVehicleContainerHighFrequency": fast},
    }
    cam = {"generationDeltaTime": cam_delta(one), "camParameters": parameters}
    at_s = (one.t_us + 30_000) / 1e6
    return {"timestamp": at_s, "fields": {"header": {"messageID": 2, "stationID": one.car}, "cam": cam}}


def its_client_message(one: Reading) -> dict[str, object]:
    message = {
        "station_id": one.car, "generation_delta_time": cam_delta(one),
        "basic_container": {
            "reference_position": {"latitude": round(one.lat * 1e7), "longitude": round(one.lon * 1e7)},
        },
        "high_frequency_container": {"heading": 0, "speed": round(one.speed_mps * 100)},
    }  # fmt: skip
    at_ms = one.t_us // 1000 + 30
    return {"message_type": "cam", "timestamp": at_ms, "message": message}


def cam_uper(one: Reading) -> bytes:
    """Pack a CAM by the published widths, up to the longitudinal acceleration."""
    fields = [
        (2, 8), (2, 8), (one.car, 32), (cam_delta(one), 16), (0, 4), (5, 8), (round(one.lat * 1e7) + 900_000_000, 31),
        (round(one.lon * 1e7) + 1_800_000_000, 32), (4095, 12), (4095, 12), (3601, 12), (900_001, 20), (15, 4), (0, 2),
        (0, 7), (0, 12), (126, 7), (round(one.speed_mps * 100), 14), (126, 7), (0, 2), (1022, 10), (4, 3), (61, 6),
        (321, 9), (102, 7), (1023, 11), (7, 3), (0, 2), (32767, 16), (8, 4),
    ]  # fmt: skip
    bits = "".join(f"{value:0{width}b}" for value, width in fields)
    return int(bits.ljust(-(-len(bits) // 8) * 8, "0"), 2).to_bytes(-(-len(bits) // 8), "big")


def _fcd(path: Path, *, geo: bool) -> None:
    steps = []
    for step in range(STEPS):
        vehicles = []
        for one in (Reading(1, step), Reading(2, step)):
            x, y = (f"{one.lon:.9f}", f"{one.lat:.9f}") if geo else ("0.00", f"{one.y_m:.4f}")
            kind = "car" if one.car == 1 else "truck"
            vehicles.append(
                f'<vehicle id="{one.car}" x="{x}" y="{y}" angle="0.0" type="{kind}" speed="{one.speed_mps}"/>'
            )
        steps.append(f'<timestep time="{step / 10:.2f}">{"".join(vehicles)}</timestep>')
    path.write_text('<?xml version="1.0"?>\n<fcd-export>\n' + "\n".join(steps) + "\n</fcd-export>\n")


def veremi_message(one: Reading) -> dict[str, object]:
    return {
        "type": 3, "rcvTime": one.t_s, "sendTime": one.t_s, "sender": one.car, "senderPseudo": one.car,
        "messageID": one.step * 10 + one.car, "pos": [0.0, one.y_m, 0.0], "spd": [0.0, one.speed_mps, 0.0],
        "acl": [0.0, 0.2, 0.0], "hed": [0.0, 1.0, 0.0],
    }  # fmt: skip


def _next_generation(path: Path) -> None:
    elements = [
        {
            "rcvTime": one.step * 10**8, "sendTime": one.step * 10**8, "sender_alias": one.car,
            "messageID": one.step * 10 + one.car, "attacker": 0,
            "sender": {"pos": [0.0, one.y_m, 0.0], "spd": one.speed_mps, "acl": 0.2, "hed": 0.0},
        }
        for one in READINGS
    ]  # fmt: skip
    path.write_text(json.dumps(elements))


def _openacc(path: Path) -> None:
    rows = ["Date,2020-10-27", "Vehicle_order,Rexton,Hyundai", "Time,Speed1,Speed2,Lat1,Lon1,Alt1,Lat2,Lon2,Alt2"]
    for step in range(STEPS):
        one, two = Reading(1, step), Reading(2, step)
        places = [f"{math.radians(r.lat):.12f},{math.radians(r.lon):.12f},300" for r in (one, two)]
        rows.append(f"{step / 10},{one.speed_mps},{two.speed_mps},{places[0]},{places[1]}")
    path.write_text("\n".join(rows) + "\n")


def _parquet(path: Path) -> None:
    header = BSM_P1_HEADER.split(",")
    cells = [bsm_p1_row(one).split(",") for one in READINGS]
    pl.DataFrame(dict(zip(header, zip(*cells, strict=True), strict=True))).write_parquet(path)


@dataclass(frozen=True, slots=True)
class Made:
    """A file of one format. Its time begins at `start_us`; ids are those of `ids`, by car."""

    write: Callable[[Path], None]
    start_us: int
    ids: tuple[str, str] = ("1", "2")


_HEX: Final = ("00000001", "00000002")
MADE: Final = {
    "bsmp1.csv": Made(_csv(BSM_P1_HEADER, bsm_p1_row), ABSOLUTE_US),
    "bsmp1.parquet": Made(_parquet, ABSOLUTE_US),
    "ode.json": Made(_lines(ode_message), ABSOLUTE_US, _HEX),
    "thea.csv": Made(_thea, ABSOLUTE_US, _HEX),
    "rsu.pcap": Made(pcap, ABSOLUTE_US, _HEX),
    "cam.pcap": Made(lambda path: pcap(path, cam_uper), ABSOLUTE_US),
    "vanetza.json": Made(_lines(vanetza_message), ABSOLUTE_US),
    "its-client.json": Made(_lines(its_client_message), ABSOLUTE_US),
    "rsu.pcapng": Made(_pcapng, ABSOLUTE_US, _HEX),
    "fcd-geo.xml": Made(lambda path: _fcd(path, geo=True), START_US),
    "fcd-local.xml": Made(lambda path: _fcd(path, geo=False), START_US),
    "veremi.json": Made(_lines(veremi_message), START_US),
    "nextgen.json": Made(_next_generation, START_US),
    "openacc.csv": Made(_openacc, 1_603_756_800_000_000, ("1-Rexton", "2-Hyundai")),
    "ngsim.csv": Made(
        _csv(
            "Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_length,v_Width,v_Vel,v_Acc,Location",
            lambda r: (
                f"{r.car},{r.step},{ABSOLUTE_US // 1000 + r.step * 100},0,{r.y_m / 0.3048:.6f},14.5,4.9,"
                f"{r.speed_mps / 0.3048:.6f},0,us-101"
            ),
        ),
        ABSOLUTE_US,
    ),
    "highd.csv": Made(
        _csv(
            "frame,id,x,y,width,height,xVelocity,yVelocity,precedingId",
            lambda r: f"{r.step * 2.5},{r.car},0,{r.y_m:.6f},4.85,2.12,0,{r.speed_mps},0",
        ),
        START_US,
    ),
    "wydot.csv": Made(
        _csv(
            "metadata_generatedAt,coreData_msgCnt,coreData_id,coreData_speed,coreData_heading,coreData_position_lat,"
            "coreData_position_long",
            lambda r: f"2023-11-14T22:13:{20 + r.t_s:.1f}Z,{r.step % 128},{r.car},{r.speed_mps},0,{r.lat:.9f},{r.lon}",
        ),
        ABSOLUTE_US,
    ),
    "gnss.csv": Made(
        _csv("t_s,id,lat,lon,speed_mps", lambda r: f"{r.t_s},{r.car},{r.lat:.9f},{r.lon},{r.speed_mps}"), START_US
    ),
}
"""By a name whose ending says nothing: `.csv` is of six formats."""


def made_files(folder: Path) -> Iterator[Path]:
    """Write them all."""
    for name, made in MADE.items():
        made.write(folder / name)
        yield folder / name
