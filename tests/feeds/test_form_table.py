"""Every form of a message and of a recording: decoded, judged from a file, and live through a service that runs.

The table of `docs/reference/feeds.md` is what these runs give. `yes` stands for the numbers of the form itself, or for
each message scored or warming; any other cell is the outcome that all messages have.
"""

import gzip
import json
import math
import re
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Final

import pytest
import zenoh
from conftest import ROOT
from e2e.serving import BLOCK, KEYS, Service
from feeds.made_forms import MESSAGES, MessageForm, bsm_v1
from gateways.recordings.made_files import ABSOLUTE_US, MADE, READINGS, STEPS, Made, Reading, pcap
from sim.loopback import session
from sim.until import until
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.recorded.refusals import Reading as Sources
from headway.cli.run.replay import Request, frames_of
from headway.edge.codec.decoder import Codec
from headway.edge.transport.message import ReceivedMessage
from headway.gateways.recordings.formats import BSM, FORMATS, open_recordings
from headway.gateways.recordings.reader import START_US
from headway_loadtest.traffic.encode import Encoder
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas.encodings import BSM_JSON, BSM_MSGPACK
from headway_schemas.frames import Frame, pack

PAGE: Final = (ROOT / "docs" / "reference" / "feeds.md").read_text(encoding="utf-8")
GATEWAY: Final = KEYS.bsm("gw-forms")
YES: Final = "yes"
Numbers = list[tuple[Any, ...]]
"""Of each message: identifier, event time, latitude, longitude, speed."""


def _mapped(path: Path) -> None:
    rows = [f"{r.car};{r.t_us / 1e3:.0f};{r.lat:.9f};{r.lon};{r.speed_mps / 0.44704:.4f}" for r in READINGS]
    path.write_text("\r\n".join(["vehID;time;Lat;Lon;v", *rows]))


def _data_wsu(path: Path) -> None:
    header = "Device,Trip,Time,GpsValidWsu,GpsTimeWsu,LatitudeWsu,LongitudeWsu,AltitudeWsu,GpsHeadingWsu,SpeedWsu,AxWsu"
    rows = [
        f"{r.car},5,{r.step * 10},1,{r.t_us // 1000},{r.lat:.9f},{r.lon},250,0.0,{r.speed_mps * 3.6:.5f},0.1"
        for r in sorted(READINGS, key=lambda r: r.car)
    ]
    path.write_text("\n".join([header, *rows]))


def _bsm_csv(path: Path) -> None:
    records = list(map(bsm_v1, READINGS))
    path.write_text("\n".join([",".join(records[0]), *(",".join(map(str, r.values())) for r in records)]))


MAPPING: Final = "id=vehID,t=time[ms],lat=Lat,lon=Lon,speed=v[mph]"
RECORDINGS: Final[dict[str, tuple[str, Made]]] = {
    "`bsm`, JSON lines": ("a.jsonl", Made(lambda path: _lines(path, MESSAGES["BSM v1, JSON"], READINGS), ABSOLUTE_US)),
    "`bsm`, CSV": ("a.csv", Made(_bsm_csv, ABSOLUTE_US)),
    "`ode`": ("ode.json", MADE["ode.json"]),
    "`thea`": ("thea.csv", MADE["thea.csv"]),
    "`cam`, vanetza-nap": ("vanetza.json", MADE["vanetza.json"]),
    "`cam`, its-client": ("its-client.json", MADE["its-client.json"]),
    "`pcap`, BSM": ("rsu.pcap", MADE["rsu.pcap"]),
    "`pcap`, CAM": ("cam.pcap", MADE["cam.pcap"]),
    "`pcap`, pcapng": ("rsu.pcapng", MADE["rsu.pcapng"]),
    "`bsmp1`, CSV": ("BsmP1.csv", MADE["bsmp1.csv"]),
    "`bsmp1`, Parquet": ("BsmP1.parquet", MADE["bsmp1.parquet"]),
    "`datawsu`": ("DataWsu.csv", Made(_data_wsu, ABSOLUTE_US, ("1-5", "2-5"))),
    "`wydot`": ("wydot.csv", MADE["wydot.csv"]),
    "`veremi`, VeReMi and F2MD": ("veremi.json", MADE["veremi.json"]),
    "`veremi`, NextGen": ("nextgen.json", MADE["nextgen.json"]),
    "`fcd`, geographic": ("fcd-geo.xml", MADE["fcd-geo.xml"]),
    "`fcd`, local": ("fcd-local.xml", MADE["fcd-local.xml"]),
    "`ngsim`": ("ngsim.csv", MADE["ngsim.csv"]),
    "`highd`": ("highd.csv", MADE["highd.csv"]),
    "`openacc`": ("openacc.csv", MADE["openacc.csv"]),
    "`gnss`": ("gnss.csv", MADE["gnss.csv"]),
    "`--columns`, in mph": ("mine.csv", Made(_mapped, ABSOLUTE_US)),
}


def _lines(path: Path, form: MessageForm, readings: Sequence[Reading]) -> None:
    path.write_bytes(b"\n".join(map(form.write, readings)))


@dataclass(slots=True)
class Live:
    """A service on loopback, and the event time that no form has used yet."""

    service: Service
    bus: zenoh.Session
    next_us: int

    def span(self, seconds: float) -> int:
        """Return the Unix time of a span that no other form uses: after it, vehicles of the same name begin again."""
        start_us = self.next_us
        self.next_us += round((seconds + 10.0) * 1e6)
        return start_us

    def outcomes(self, put: Callable[[], int]) -> Counter[str]:
        """Return the outcomes of what is put, once every message has one."""
        before = Counter(self.service.metric("headway_records_total"))
        total = before.total() + put()
        until(lambda: sum(self.service.metric("headway_records_total").values()) == total)
        return Counter(self.service.metric("headway_records_total")) - before


@pytest.fixture(scope="module")
def live(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Live]:
    settings = {"HEADWAY_MAX_AGE_S": "3600", "HEADWAY_VEHICLE_CAPACITY": "256"}
    service = Service(tmp_path_factory.mktemp("forms"), settings)
    with session("client", connect=(service.endpoint,)) as bus:
        yield Live(service, bus, time.time_ns() // 1000 - 3_300_000_000)
    service.kill()


def in_short(outcomes: Counter[str], messages: int) -> str:
    """Return `yes` where all are scored or warming; else the outcomes."""
    assert outcomes.total() == messages
    return YES if set(outcomes) <= {"scored", "warming"} else " ".join(f"`{word}`" for word in sorted(outcomes))


def judge(*arguments: str | Path) -> Counter[str]:
    ran = CliRunner().invoke(app, ["judge", *map(str, arguments), "--json"])
    if ran.exit_code and "no row can be read" in str(ran.exception):
        return Counter()
    assert ran.exit_code == 0, ran.exception
    return Counter(json.loads(ran.stdout)["outcomes"])


def replayed(live: Live, sources: Sources, speed: float = 1.0) -> tuple[Counter[str], int]:
    """Replay as the command does, without its pauses."""
    frames, length_s = frames_of(Request(sources, KEYS.site, speed, None, 0, 3600.0))
    schedule = Schedule(start_ns=0, start_unix_us=live.span(length_s))
    sent = 0

    def put() -> int:
        nonlocal sent
        for batch in Encoder(KEYS).batches(frames, schedule):
            for key, payload in zip(batch.keys, batch.payloads, strict=True):
                live.bus.put(str(key), payload, encoding=BSM_MSGPACK, congestion_control=BLOCK)
            sent += len(batch.payloads)
        return sent

    return live.outcomes(put), sent


def expected(readings: Sequence[Reading], ids: tuple[str, str], start_us: int) -> Numbers:
    return [(ids[(r.car - 1) % 2], start_us + r.step * 100_000, r.lat, r.lon, r.speed_mps) for r in readings]


def assert_same(found: Numbers, wanted: Numbers) -> None:
    assert len(found) == len(wanted)
    for one, other in zip(sorted(found), sorted(wanted), strict=True):
        assert one[:2] == other[:2]
        assert one[2:4] == pytest.approx(other[2:4], abs=1.1e-7)
        assert one[4] == pytest.approx(other[4], abs=0.011)


def read(path: Path, columns: str | None = None) -> Numbers:
    """Return the numbers of a recording."""
    with open_recordings([str(path)], columns=columns) as recordings:
        rows = [row.record for chunk in recordings.chunks for row in chunk if row.record]
    return [(r["id"], r["t_us"], r["lat"], r["lon"], r["speed_mps"]) for r in rows]


ROWS = re.findall(
    r"^\| (?!form \||---)(.*) \| .* \| .* \| .* \|$", PAGE.partition("## Forms")[2].partition("\n## ")[0], re.MULTILINE
)


def test_the_table_has_every_form_and_no_other() -> None:
    assert [*MESSAGES, *RECORDINGS] == ROWS


def test_the_table_has_every_format() -> None:
    assert {re.match(r"`(\S+)`", name)[1] for name in RECORDINGS} == {BSM, "--columns", *FORMATS}  # type: ignore[index]


@pytest.mark.parametrize("name", RECORDINGS)
def test_a_recording_is_decoded_judged_and_live(name: str, live: Live, tmp_path: Path) -> None:
    file, made = RECORDINGS[name]
    path, columns = tmp_path / file, MAPPING if file == "mine.csv" else None
    made.write(path)
    assert_same(read(path, columns), expected(READINGS, made.ids, made.start_us))
    judged = judge(path, *(["--columns", columns] if columns else []))
    assert set(judged) <= {"scored", "warming"}
    outcomes, sent = replayed(live, Sources([str(path)], columns=columns))
    assert sent == len(READINGS)
    cells = (YES, in_short(judged, len(READINGS)), in_short(outcomes, sent))
    assert f"| {name} | {' | '.join(cells)} |" in PAGE


@pytest.mark.parametrize("name", MESSAGES)
def test_a_message_is_decoded_judged_and_live(name: str, live: Live, tmp_path: Path) -> None:
    form = MESSAGES[name]
    start_us = live.span(STEPS / 10) // 1000 * 1000
    # A car of its own for each form: the identifier of another one is where that one was.
    first = 1 + 2 * list(MESSAGES).index(name)
    readings = [Reading(first + car, step, start_us) for step in range(STEPS) for car in (0, 1)]
    ids = tuple(_id(name, first + car) for car in (0, 1))
    payloads = _payloads(form, readings)
    decoded = Codec(KEYS).decode(
        [ReceivedMessage(GATEWAY, payload, form.encoding, True, start_us + 7_000_000, 0) for payload in payloads]
    )
    batch = decoded.batch
    refused = {rejection.reason.outcome.label for rejection in decoded.rejections}
    if not refused:
        columns = (
            batch.ids.tolist(),
            *(c.tolist() for c in (batch.t_us, batch.lat_deg, batch.lon_deg, batch.speed_mps)),
        )
        found = [(vehicle.decode(), *numbers) for vehicle, *numbers in zip(*columns, strict=True)]
        assert_same(found, expected(readings, ids, start_us))
    cells = [" ".join(f"`{word}`" for word in sorted(refused)) or YES]

    path = tmp_path / f"a.{form.container}"
    if not form.container:
        cells.append("no such recording")
    else:
        path = path.with_suffix(".jsonl" if form.encoding == BSM_JSON else path.suffix)
        (_lines if form.container == "lines" else pcap_of)(path, form, readings)
        judged = judge(path)
        cells.append(in_short(judged, len(readings)) if judged else "`other_message`")
        if judged:
            assert_same(read(path), expected(readings, ids, start_us))

    def put() -> int:
        for payload in payloads:
            live.bus.put(GATEWAY, payload, encoding=form.encoding, congestion_control=BLOCK)
        return len(readings)

    cells.append(in_short(live.outcomes(put), len(readings)))
    assert f"| {name} | {' | '.join(cells)} |" in PAGE


def _id(name: str, car: int) -> str:
    return str(car) if name.startswith(("BSM v1", "CAM")) else f"{car:08X}"


def _payloads(form: MessageForm, readings: Sequence[Reading]) -> list[bytes]:
    """Return what a gateway puts: frames in bundles, or each message of BSM v1 by itself."""
    if form.encoding in (BSM_MSGPACK, BSM_JSON):
        return list(map(form.write, readings))
    frames = [Frame(form.write(one), one.t_us + 20_000, "10.0.0.7") for one in readings]
    return [pack(frames[at : at + 2]) for at in range(0, len(frames), 2)]


def pcap_of(path: Path, form: MessageForm, readings: Sequence[Reading]) -> None:
    pcap(path, form.write, readings)


CASES: Final = ROOT.parent / "shared" / "cases"
SPMD_2004_US: Final = 1_072_915_200_000_000


def bsm_p1_numbers(path: Path) -> Numbers:
    """Read the rows with all numbers, by the places of their columns alone."""
    text = path.read_bytes()
    text = gzip.decompress(text) if text[:2] == b"\x1f\x8b" else text
    rows = [re.split("[,;]", line.strip().strip(",;")) for line in text.decode("utf-8-sig").splitlines()]
    found: Numbers = []
    for cells in ([cell.strip(' "') for cell in row] for row in rows):
        try:
            numbers = [float(cells[at]) for at in (3, 7, 8, 10, 18)]
        except (ValueError, IndexError):
            continue
        if not any(map(math.isnan, numbers)):
            found.append((cells[2], SPMD_2004_US + int(cells[3]), *numbers[1:4]))
    return found


PLAIN: Final = sorted(
    path for path in (CASES / "files").glob("BsmP1_*.csv*") if not re.search("empty|zero|sentinels", path.name)
)


@pytest.mark.skipif(not PLAIN, reason=f"files as they are found are not at {CASES}")
@pytest.mark.parametrize("path", PLAIN, ids=lambda path: path.name)
def test_a_file_of_spmd_is_decoded_judged_and_live(path: Path, live: Live) -> None:
    numbers = bsm_p1_numbers(path)
    assert_same(read(path), numbers)
    rows = sum(judge(path).values())
    outcomes, sent = replayed(live, Sources([str(path)]))
    assert (sent, outcomes.total()) == (len(numbers), len(numbers))
    assert 0 <= rows - len(numbers) <= 1
    assert set(outcomes) <= {"scored", "warming", "out_of_range"}


OTHERS: Final[dict[str, Callable[[str], tuple[str, int, float]]]] = {
    "bsmTx.json": lambda t: ("31325433", instant(json.loads(t)["metadata"]["recordGeneratedAt"]), 0.4),
    "fcd.xml": lambda t: ("veh0", START_US, float(found(r' speed="([\d.]+)"', t))),
    "highD_tracks.csv": lambda t: ("1", START_US + 40_000, float(t.splitlines()[1].split(",")[6])),
    "ngsim.csv": lambda t: ("2", int(t.splitlines()[1].split(",")[3]) * 1000, float(cell(t, "v_Vel")) * 0.3048),
    "traceJSON-9-7-A0-25200-7.json": lambda _: ("10155", START_US + 25_200_200_000, math.hypot(-2.1, 12.9)),
    "veremi_ng.json": lambda t: ("10021", START_US + 25_200_000_000, json.loads(t)[0]["sender"]["spd"]),
    "openacc.csv": lambda t: (
        "1-Rexton",
        instant(found(r"Date,(\S+)", t) + "T00:00:00Z"),
        float(t.split()[5].split(",")[1]),
    ),
    "wydot_bsm.csv": lambda t: (
        cell(t, "coreData_id"),
        american(cell(t, "metadata_generatedAt")),
        float(cell(t, "coreData_speed")),
    ),
}
"""Identifier, time and speed of the first message, from the text of the file."""


def found(pattern: str, text: str) -> str:
    match = re.search(pattern, text)
    assert match is not None
    return match[1]


def cell(text: str, column: str) -> str:
    header, row, *_ = text.splitlines()
    return dict(zip(header.split(","), re.sub(r"POINT \([^)]*\)", "", row).split(","), strict=False))[column]


def american(text: str) -> int:
    return round(datetime.strptime(text, "%m/%d/%Y %I:%M:%S.%f %p %z").timestamp() * 1e6)


def instant(text: str) -> int:
    return round(datetime.fromisoformat(text).timestamp() * 1e6)


@pytest.mark.parametrize("name", OTHERS)
def test_a_file_of_another_system_is_decoded_judged_and_live(name: str, live: Live) -> None:
    path = CASES / "other" / name
    if not path.is_file():
        pytest.skip(f"rows of other formats are not at {CASES}")
    vehicle, t_us, speed_mps = OTHERS[name](path.read_text())
    numbers = read(path)
    assert numbers[0][:2] == (vehicle, t_us)
    assert numbers[0][4] == pytest.approx(speed_mps)
    assert in_short(judge(path), len(numbers)) == YES
    outcomes, sent = replayed(live, Sources([str(path)]))
    assert in_short(outcomes, sent) == YES
