"""Every format, every compression: the records are the numbers of the file, and nothing else."""

import bz2
import gzip
import json
import lzma
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import zstandard
from gateways.recordings.made_files import (
    ABSOLUTE_US,
    BSM_P1_HEADER,
    MADE,
    READINGS,
    Reading,
    bsm_p1_row,
    ode_message,
    veremi_message,
)

from headway.gateways.recordings.formats import FORMATS, Located, open_recordings
from headway.gateways.recordings.reader import RecordingError


def rows_of(*paths: Path, **options: Any) -> list[Located]:
    with open_recordings([str(path) for path in paths], **options) as recordings:
        return [located for chunk in recordings.chunks for located in chunk]


def records_of(path: Path, **options: Any) -> list[dict[str, Any]]:
    return [row.record for row in rows_of(path, **options) if row.record]


@pytest.mark.parametrize("name", MADE)
def test_the_records_are_the_numbers_of_the_file(tmp_path: Path, name: str) -> None:
    made, path = MADE[name], tmp_path / name
    made.write(path)
    records = records_of(path)
    assert len(records) == len(READINGS)
    for one, record in zip(READINGS, records, strict=True):
        assert record["id"] == made.ids[one.car - 1]
        assert record["t_us"] == made.start_us + one.step * 100_000
        assert record["msg_cnt"] == one.step % 128
        assert record["lat"] == pytest.approx(one.lat, abs=1e-7)
        assert record["lon"] == pytest.approx(one.lon, abs=1e-7)
        assert record["speed_mps"] == pytest.approx(one.speed_mps, abs=0.011)
        assert record.get("heading_deg", 0.0) == pytest.approx(0.0, abs=1e-9)


def test_each_format_is_recognised_by_the_content_alone(tmp_path: Path) -> None:
    for name, made in MADE.items():
        path = tmp_path / "recording.BIN" if not name.endswith(".parquet") else tmp_path / "recording"
        made.write(path)
        by_content = records_of(path)
        word = (
            next(word for word, form in FORMATS.items() if form.recognise(path.read_bytes()[:65_536]))
            if (not name.endswith(".parquet"))
            else "bsmp1"
        )
        assert records_of(path, form=word) == by_content, name


def zipped(content: bytes, path: Path) -> None:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("folder/BSMP1.CSV", content)


COMPRESSIONS: list[tuple[str, Callable[[bytes, Path], object]]] = [
    ("a.CSV.GZ", lambda content, path: path.write_bytes(gzip.compress(content))),
    ("a.csv.zst", lambda content, path: path.write_bytes(zstandard.compress(content))),
    ("a.zip", zipped),
    ("a.csv.bz2", lambda content, path: path.write_bytes(bz2.compress(content))),
    ("a.csv.xz", lambda content, path: path.write_bytes(lzma.compress(content))),
    ("a.csv", lambda content, path: path.write_bytes(b"\xef\xbb\xbf" + content.replace(b"\n", b"\r\n"))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b"\n", b"\r"))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b",", b";"))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b",", b";").replace(b".", b","))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b"GenTime", b"Gentime"))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(BSM_P1_HEADER.encode() + b"\n", b""))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b"\n", b",\n"))),
    ("a.csv", lambda content, path: path.write_bytes(content.replace(b",", b", "))),
    (
        "a.csv",
        lambda content, path: path.write_bytes(b'"' + content.replace(b",", b'","').replace(b"\n", b'"\n"')[:-1]),
    ),
]


@pytest.mark.parametrize(("name", "write"), COMPRESSIONS)
def test_each_dress_of_a_table_gives_the_same(
    tmp_path: Path, name: str, write: Callable[[bytes, Path], object]
) -> None:
    plain = tmp_path / "plain.csv"
    MADE["bsmp1.csv"].write(plain)
    write(plain.read_bytes(), tmp_path / name)
    assert records_of(tmp_path / name) == records_of(plain)


def test_a_file_without_a_name_in_an_archive_is_read(tmp_path: Path) -> None:
    plain, archive = tmp_path / "plain.csv", tmp_path / "a.zip"
    MADE["bsmp1.csv"].write(plain)
    zipped(plain.read_bytes(), archive)
    archive.write_bytes(archive.read_bytes().replace(b"folder/BSMP1.CSV", b"\0older/BSMP1.CSV"))
    assert records_of(archive, form="bsmp1") == records_of(plain)


def test_a_name_says_nothing_where_the_format_is_named(tmp_path: Path) -> None:
    record = {"v": 1, "id": "a", "msg_cnt": 1, "t_us": ABSOLUTE_US, "lat": 42.3, "lon": -83.7, "speed_mps": 13.5}
    table = pl.DataFrame([record])
    (tmp_path / "a.txt").write_text("\ufeff" + json.dumps(record))
    (tmp_path / "b.txt").write_text(table.rename(str.upper).write_csv())
    table.rename(str.upper).write_parquet(tmp_path / "c.txt")
    assert [records_of(tmp_path / name, form="bsm") for name in ("a.txt", "b.txt", "c.txt")] == [[record]] * 3


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("a.csv", "VehicleId,Time,Lat,Lon,Speed\na,1,42,-83,13\n".encode("utf-16"), "text in UTF-16: save it as UTF-8"),
        ("a.csv", b"VehicleId,Time,Lat,Lon,Speed\na,1,42,-83,13\n", "a table of your own needs --columns"),
        ("a.csv.gz", gzip.compress(b""), "empty"),
        ("a.parquet.gz", gzip.compress(b"PAR1"), "Parquet is read from an uncompressed file only"),
        ("a.zip", b"PK\5\6" + bytes(18), "0 files in the archive"),
        ("a.csv.bz2", bz2.compress(bytes(range(256)) * 99)[:-9], "cut or damaged"),
        ("a.csv.xz", lzma.compress(bytes(range(256)) * 99)[:-9], "cut or damaged"),
    ],
)
def test_what_is_no_recording_is_one_line(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        rows_of(tmp_path / name)


@pytest.mark.parametrize(
    ("term", "cell", "words"),
    [
        ("t=time", "1700000000000000", "column time: not a time in s"),
        ("t=time[iso]", "11/14/2023", "column time: not a time of ISO 8601"),
        ("t=time[ms]", "noon", "column time: not a time in ms"),
        ("t=0,accel=time", "hard", "column time: not a number"),
    ],
)
def test_a_cell_of_another_kind_is_said_by_what_it_must_be(tmp_path: Path, term: str, cell: str, words: str) -> None:
    path = tmp_path / "mine.csv"
    path.write_text(f"Car,Time,Y,X,V,0\na,{cell},1,1,1,1\n")
    with pytest.raises(RecordingError, match=words):
        rows_of(path, columns=f"id=car,lat=y,lon=x,speed=v,{term}")


@pytest.mark.parametrize("word", ["N/A", "\\N", "NaN", "", "NULL"])
def test_a_cell_without_a_value_is_unavailable_and_the_rest_is_read(tmp_path: Path, word: str) -> None:
    rows = [bsm_p1_row(one) for one in READINGS]
    rows[7] = rows[7].replace(f"{READINGS[7].speed_mps:.2f}", word)
    rows[9] = rows[9].replace(f"{READINGS[9].speed_mps:.2f}", "fast")
    rows[-1] = rows[-1][:50]
    path = tmp_path / "a.csv"
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    found = rows_of(path)
    refused = {row.number: row.refusal for row in found if row.refusal}
    assert {number: refusal.reason for number, refusal in refused.items()} == {
        9: "unavailable",
        11: "malformed",
        len(rows) + 1: "malformed",
    }
    assert "Speed" in refused[9].detail
    assert sum(row.refusal is None for row in found) == len(READINGS) - 3


@pytest.mark.parametrize("end", [b"\r", b"\n", b"\0", b'"', b",;|\t"])
def test_the_octets_of_a_capture_decide_nothing(tmp_path: Path, end: bytes) -> None:
    """A capture is recognised with any octets in its first packets, such as those that end a line or open a quote."""
    MADE["rsu.pcap"].write(tmp_path / "plain.pcap")
    content = (tmp_path / "plain.pcap").read_bytes()
    # Addresses of Ethernet, after the header of the file and of the packet.
    (tmp_path / "odd.pcap").write_bytes(content[:40] + (end * 12)[:12] + content[52:])
    assert records_of(tmp_path / "odd.pcap") == records_of(tmp_path / "plain.pcap")


def test_nothing_is_moved_smoothed_or_left_out(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    places = [(0.0, 0.0), (42.0, 180.0), (42.0, -180.0), (42.1, 179.9999999), (-89.9, 12.5)]
    rows = [
        bsm_p1_row(Reading(1, step)).replace(f"{Reading(1, step).lat:.9f},{Reading(1, step).lon:.7f}", f"{lat},{lon}")
        for step, (lat, lon) in enumerate(places)
    ]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    assert [(record["lat"], record["lon"]) for record in records_of(path)] == places


def test_days_and_receivers_are_drives_of_their_own_in_the_order_of_time(tmp_path: Path) -> None:
    path, day_us = tmp_path / "a.csv", 86_400_000_000
    rows = [
        bsm_p1_row(one, receiver=receiver, us=ABSOLUTE_US + day * day_us)
        for one in reversed(READINGS)
        for receiver in (17, 18)
        for day in (0, 1)
    ]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    drives: dict[str, list[int]] = {}
    for row in rows_of(path):
        drives.setdefault(row.drive, []).append(row.record["t_us"])
    assert len(drives) == 4
    for times in drives.values():
        assert times == sorted(times)
        assert times[-1] - times[0] < day_us


def test_other_messages_are_named_and_no_row_at_all_is_an_error(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    other = {"metadata": {"odeReceivedAt": "2024-08-12T12:32:03Z"}, "payload": {"data": {"SPAT": {}}}}
    timeless = {"payload": {"data": {"coreData": {"secMark": 1, "id": "00000001"}}}}
    lines = [json.dumps(message) for message in (ode_message(READINGS[0]), other, timeless)]
    path.write_text("\n".join([*lines, lines[0][:-30]]))
    reasons = [row.refusal.reason if row.refusal else "" for row in rows_of(path)]
    assert reasons == ["", "other_message", "unreadable_time", "malformed"]
    path.write_text("\n".join(lines[1:]))
    with pytest.raises(RecordingError, match=r"line 1: .*; no row can be read"):
        rows_of(path)


@pytest.mark.parametrize("indent", [None, 1])
def test_messages_may_be_spread_over_lines_and_in_an_array(tmp_path: Path, indent: int | None) -> None:
    path, lines = tmp_path / "a.json", tmp_path / "lines.json"
    messages = list(map(ode_message, READINGS))
    MADE["ode.json"].write(lines)
    path.write_text("\n".join(json.dumps(message, indent=1) for message in messages))
    assert records_of(path) == records_of(lines)
    path.write_text(json.dumps(messages, indent=indent))
    assert records_of(path) == records_of(lines)
    path.write_text(json.dumps(messages, indent=indent)[:-40])
    assert records_of(path) == records_of(lines)[:-1]


def test_ground_truth_is_apart_from_the_records(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    own = {"type": 2, "rcvTime": 0.0, "pos": [1.0, 2.0, 0.0], "spd": [1.0, 0.0, 0.0]}
    truth = {"type": 4, "time": 0.1, "sender": 1, "attackerType": 16, "messageID": 1, "pos": [9.0, 9.0, 0.0]}
    path.write_text("\n".join(map(json.dumps, (own, truth, veremi_message(READINGS[0])))))
    label, message = rows_of(path)
    assert (label.record, label.truth) == ({}, ("1", True))
    assert message.truth == ("1", None)
    assert not {"attackerType", "attacker", "messageID"} & message.record.keys()


@pytest.mark.parametrize(
    ("columns", "row", "expected"),
    [
        ("id=car,t=time[ms],lat=y,lon=x,speed=v[mph]", "a,1500,42.5,-83,10", {"t_us": 1_500_000, "speed_mps": 4.4704}),
        ("id=car,t=time,lat=y,lon=x,speed=v[km/h]", "a,1.5,42.5,-83,36", {"t_us": 1_500_000, "speed_mps": 10.0}),
        ("id=car,t=time[ns],lat=y,lon=x,speed=v[kn]", "a,1700000000123456789,42.5,-83,10",
         {"t_us": 1_700_000_000_123_456, "speed_mps": 5.144444}),
        ("id=car,t=time[iso],lat=y,lon=x,speed=v", "a,2024-01-01T00:00:00.5,42,-83,1", {"t_us": 1_704_067_200_500_000}),
        ("id=car,t=time[cs],lat=y[rad],lon=x[rad],speed=v", "a,150,0.5,-1,1", {"t_us": 1_500_000, "lat": 28.6478898}),
        ("id=car,t=time,x=x[ft],y=y[ft],speed=v[ft/s],origin=42/-83", "a,1,0,0,10", {"lat": 42.0, "lon": -83.0}),
        ("id=car,t=time,lat=y,lon=x,speed=v,heading=h[deg math]", "a,1,1,1,1,90", {"heading_deg": 0.0}),
        ("id=car,t=time,lat=y,lon=x,speed=v,heading=h[rad]", "a,1,1,1,1,3.141592653589793", {"heading_deg": 180.0}),
        ("id=car,t=time,lat=y,lon=x,vx=v,vy=h", "a,1,1,1,3,-4", {"heading_deg": 143.130102, "speed_mps": 5.0}),
    ],
)  # fmt: skip
def test_a_mapping_has_units(tmp_path: Path, columns: str, row: str, expected: dict[str, float]) -> None:
    path = tmp_path / "mine.txt"
    path.write_text(f"Car,Time,Y,X,V,H\n{row}{',0' if row.count(',') == 4 else ''}\n")
    (record,) = records_of(path, columns=columns)
    assert {name: record[name] for name in expected} == pytest.approx(expected)


def test_a_column_with_any_name_is_named_in_quotes(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("vehicle+trip;Time, s;Y;X;Speed [mph]\na;1.5;42.5;-83;10\n")
    (record,) = records_of(path, columns='id="vehicle+trip",t="Time, s",lat=Y,lon=X,speed="speed [mph]"[mph]')
    assert (record["id"], record["t_us"], record["speed_mps"]) == ("a", 1_500_000, pytest.approx(4.4704))


@pytest.mark.parametrize(
    ("columns", "words"),
    [
        ("id=car", "missing: t, lat and lon, or x and y, speed"),
        ("id=car,t=time[hours],lat=y,lon=x,speed=v", "t: no unit hours: choose from s, ms"),
        ("id=car,t=time,lat=y,lon=x,speed=v[c]", "speed: no unit c"),
        ("id=car,t=time,lat=y,lon=x,velocity=v", "no field velocity: choose from id"),
        ("id=car,t=time,lat=y,lon=x,speed=pace", "no column pace: the table has Car, Time"),
        ("id:car", "write FIELD=COLUMN"),
        ("", "write FIELD=COLUMN"),
        ('id="car', "write FIELD=COLUMN"),
    ],
)
def test_a_mapping_that_cannot_be_used_is_one_line(tmp_path: Path, columns: str, words: str) -> None:
    path = tmp_path / "mine.csv"
    path.write_text("Car,Time,Y,X,V,H\na,1,1,1,1,0\n")
    with pytest.raises(RecordingError, match=words):
        rows_of(path, columns=columns)


def test_a_folder_stands_for_the_safety_pilot_tables_in_it_or_the_recordings_of_a_format(tmp_path: Path) -> None:
    (tmp_path / "one" / "two").mkdir(parents=True)
    MADE["bsmp1.csv"].write(tmp_path / "one" / "BsmP1.CSV")
    MADE["gnss.csv"].write(tmp_path / "one" / "two" / "drive.csv")
    (tmp_path / "one" / "README.txt").write_text("nothing to read")
    (tmp_path / "one" / "DataLane.csv").write_text("Device,Trip,Time,LaneDistanceLeft\n1,1,1,0\n")
    (tmp_path / "one" / "BsmP1_empty.csv").write_text(BSM_P1_HEADER + "\n")
    (tmp_path / "one" / "nothing.csv").write_text("")
    found = rows_of(tmp_path / "one")
    assert len(found) == len(READINGS)
    assert {Path(row.source.name).name for row in found} == {"BsmP1.CSV"}
    assert {Path(row.source.name).name for row in rows_of(tmp_path / "one", form="gnss")} == {"drive.csv"}
    with pytest.raises(RecordingError, match="Is a directory: name the recordings in it"):
        rows_of(tmp_path / "one", form="pcap")


DATA_WSU = "Device,Trip,Time,GpsValidWsu,GpsTimeWsu,LatitudeWsu,LongitudeWsu,AltitudeWsu,GpsHeadingWsu,SpeedWsu,AxWsu"


def test_a_car_of_spmd_has_its_speed_in_kilometres_an_hour_and_its_trips_apart(tmp_path: Path) -> None:
    path = tmp_path / "DataWsu.csv"
    rows = [
        "101,5,1000,1,500010000,42.30,-83.70,250.0,45.0,52.57,0.1",
        "101,5,1010,1,500010100,42.31,-83.71,250.0,45.0,36.00,0.1",
        "101,6,1000,1,500010100,42.32,-83.72,250.0,360.0,N/A,0.1",
        "101,6,1010,0,500010200,42.33,-83.73,250.0,45.0,7.20,0.1",
        "101,6,1020,1,500010300,42.34,-83.74,250.0,45.0,7.20,0.1",
    ]
    path.write_text("\ufeff" + "\r\n".join([DATA_WSU, *rows]))
    found = rows_of(path)
    good = [row for row in found if row.refusal is None]
    assert [row.record["id"] for row in good] == ["101-5", "101-5", "101-6"]
    assert [row.record["t_us"] for row in good] == [500_010_000_000, 500_010_100_000, 500_010_300_000]
    assert [row.record["speed_mps"] for row in good] == pytest.approx([52.57 / 3.6, 10.0, 2.0])
    assert good[0].drive == good[1].drive != good[2].drive
    assert [(row.number, row.refusal.reason) for row in found if row.refusal] == [
        (4, "unavailable"),
        (5, "unavailable"),
    ]
