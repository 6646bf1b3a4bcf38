"""`headway judge`: the same bytes twice, one line for what cannot be read, and a summary that adds up."""

import csv
import gzip
import json
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import polars as pl
import pytest
import zstandard
from made_recording import made_recording
from typer.testing import CliRunner

from headway.cli.app import app
from headway.detector import Detector
from headway.errors import UserError
from headway.result import VERDICTS

RECORDS = made_recording()
LINES = "".join(json.dumps(record) + "\n" for record in RECORDS).encode()


class Done(NamedTuple):
    returncode: int
    stdout: bytes
    stderr: bytes


def judge(*arguments: str | Path, stdin: bytes | None = None) -> Done:
    """Run the command, in this process unless it needs a standard input."""
    command = ["judge", *map(str, arguments)]
    if stdin is not None:
        done = subprocess.run(
            [sys.executable, "-m", "headway", *command], input=stdin, capture_output=True, check=False
        )
        return Done(done.returncode, done.stdout, done.stderr)
    ran = CliRunner().invoke(app, command)
    if isinstance(ran.exception, UserError):
        return Done(2, ran.stdout_bytes, f"headway: {ran.exception}\n".encode())
    assert ran.exception is None or isinstance(ran.exception, SystemExit)
    return Done(ran.exit_code, ran.stdout_bytes, ran.stderr_bytes)


def summary(*arguments: str | Path, stdin: bytes | None = None) -> dict[str, Any]:
    done = judge(*arguments, "--json", stdin=stdin)
    assert (done.returncode, done.stderr) == (0, b"")
    shown: dict[str, Any] = json.loads(done.stdout)
    return shown


@pytest.fixture(scope="module", autouse=True)
def _kernels() -> None:
    """Have them compiled, so that no run says that it compiles."""
    Detector()


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = tmp_path / "road.jsonl"
    path.write_bytes(LINES)
    return path


def test_the_summary_counts_records_vehicles_time_and_alarms(recording: Path) -> None:
    shown = summary(recording)
    assert list(shown) == [
        "records",
        "outcomes",
        "vehicles",
        "vehicle_hours",
        "events",
        "alarms",
        "alarms_per_vehicle_hour",
        "sensor_quality",
    ]
    assert shown["records"] == len(RECORDS) == sum(shown["outcomes"].values())
    assert shown["vehicles"] == 4
    assert shown["vehicle_hours"] == pytest.approx(4 * 19.9 / 3600, abs=1e-6)
    assert shown["alarms"] == sum(shown["events"].values()) >= 1
    assert shown["alarms_per_vehicle_hour"] == pytest.approx(shown["alarms"] / shown["vehicle_hours"], rel=1e-3)


def test_the_summary_says_what_each_vehicles_sensors_are_like(recording: Path) -> None:
    found = summary(recording)["sensor_quality"]
    detector = Detector()
    detector.process(RECORDS)
    qualities = {quality.vehicle: quality for quality in detector.qualities()}
    assert found.keys() == qualities.keys() == {record["id"] for record in RECORDS}
    for vehicle, quality in found.items():
        assert quality["level"] == qualities[vehicle].level
        assert quality["speed_noise_mps"] == qualities[vehicle].speed_noise_mps


def test_events_and_verdicts_are_those_of_the_detector(recording: Path, tmp_path: Path) -> None:
    summary(recording, "--events", tmp_path / "events.jsonl", "--verdicts", tmp_path / "verdicts.csv")
    detector = Detector()
    result, rest = detector.process(RECORDS), detector.finish()
    events = [event.model_dump_json() for event in result.events + rest.events]
    assert (tmp_path / "events.jsonl").read_text().splitlines() == events
    with (tmp_path / "verdicts.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert list(rows[0]) == ["id", "t_us", *VERDICTS.names]
    assert [row["id"] for row in rows] == [record["id"] for record in RECORDS]
    assert [row["outcome"] for row in rows] == result.verdicts["outcome"].tolist()
    assert [float(row["statistic"]) for row in rows] == result.verdicts["statistic"].tolist()


def test_two_runs_write_the_same_bytes(recording: Path, tmp_path: Path) -> None:
    runs = []
    for run in ("a", "b"):
        files = [tmp_path / f"{run}.jsonl", *(tmp_path / f"{run}-verdicts.{e}" for e in ("csv", "jsonl", "parquet"))]
        done = [judge(recording, "--json", "--events", files[0], "--verdicts", file) for file in files[1:]]
        runs.append([*(one.stdout for one in done), *(file.read_bytes() for file in files)])
    assert runs[0] == runs[1]


@pytest.mark.parametrize(
    ("ending", "write"),
    [
        (".jsonl.gz", lambda path, _: path.write_bytes(gzip.compress(LINES))),
        (".jsonl.zst", lambda path, _: path.write_bytes(zstandard.compress(LINES))),
        (".ndjson", lambda path, _: path.write_bytes(b"\xef\xbb\xbf" + LINES.replace(b"\n", b"\r\n\r\n"))),
        (".csv", lambda path, table: table.write_csv(path)),
        (".csv.gz", lambda path, table: path.write_bytes(gzip.compress(table.write_csv().encode()))),
        (".parquet", lambda path, table: table.write_parquet(path)),
    ],
)
def test_every_form_of_a_recording_gives_the_same(
    recording: Path, tmp_path: Path, ending: str, write: Callable[[Path, pl.DataFrame], None]
) -> None:
    path = tmp_path / f"other{ending}"
    write(path, pl.DataFrame(RECORDS))
    assert summary(path) == summary(recording)


def test_standard_input_is_a_recording_of_lines_or_csv(recording: Path) -> None:
    whole = summary(recording)
    assert summary("-", stdin=LINES) == whole
    assert summary("-", stdin=gzip.compress(LINES)) == whole
    assert summary("-", stdin=pl.DataFrame(RECORDS).write_csv().encode()) == whole


def test_several_recordings_are_merged_by_the_time_of_reception(recording: Path, tmp_path: Path) -> None:
    for car in range(4):
        of_car = [record for record in RECORDS if record["id"] == f"car{car}"]
        (tmp_path / f"{car}.jsonl").write_text("".join(json.dumps(record) + "\n" for record in of_car))
    assert summary(*(tmp_path / f"{car}.jsonl" for car in range(4))) == summary(recording)


def test_settings_come_from_options_over_the_file(recording: Path, tmp_path: Path) -> None:
    config = tmp_path / "headway.toml"
    config.write_text('site = "east"\nmax_age_s = 0.001\n')
    events = tmp_path / "events.jsonl"
    assert set(summary(recording, "--config", config)["outcomes"]) == {"too_old"}
    assert summary(recording, "--config", config, "--set", "max_age_s=5", "--events", events)["alarms"] > 0
    assert json.loads(events.read_text().splitlines()[0])["site"] == "east"


def test_invalid_values_are_outcomes(tmp_path: Path) -> None:
    changes: list[Mapping[str, Any]] = [{}, {"speed_mps": 999.0}, {"v": 2}, {"lat": None}]
    path = tmp_path / "faults.jsonl"
    path.write_text("".join(json.dumps(RECORDS[0] | change) + "\n" for change in changes))
    assert summary(path)["outcomes"] == {"out_of_range": 1, "unavailable": 1, "warming": 1, "wrong_version": 1}


def written(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path


CSV_LINES = pl.DataFrame(RECORDS[:3]).write_csv().splitlines()


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.jsonl", b"", "empty"),
        ("empty.csv", CSV_LINES[0].encode(), "no records"),
        ("blank.jsonl", b"\n\n", "no records"),
        ("cut.jsonl", LINES[:-40], f"line {len(RECORDS)}: not JSON"),
        ("word.jsonl", json.dumps(RECORDS[0] | {"speed_mps": "fast"}).encode(), "line 1: speed_mps: "),
        ("field.jsonl", json.dumps(RECORDS[0] | {"speed": 1}).encode(), "line 1: a field that version 1 does not have"),
        ("received.jsonl", json.dumps(RECORDS[0] | {"received_us": -1}).encode(), "line 1: received_us is -1"),
        ("array.jsonl", b"[1, 2]\n", "line 1: not a map"),
        ("number.csv", "\n".join([*CSV_LINES, CSV_LINES[1].replace("-83.0", "west")]).encode(), "line 5: lon: 'west'"),
        ("cells.csv", "\n".join([*CSV_LINES, "1,car"]).encode(), "line 5: 2 cells where the header has 9"),
        ("column.csv", CSV_LINES[0].replace("speed_mps", "speed").encode(), "unknown column speed"),
        ("missing.csv", b"id,t_us\na,1\n", "column msg_cnt is missing"),
        ("table.parquet", LINES, "table.parquet: "),
        ("road.xlsx", LINES, "no recording by its ending"),
        ("cut.jsonl.gz", gzip.compress(LINES)[:-100], "cut or damaged"),
        ("latin.csv", b"id,\xff\n", "not UTF-8"),
    ],
)
def test_what_cannot_be_read_is_one_line_and_status_2(tmp_path: Path, name: str, content: bytes, words: str) -> None:
    verdicts = tmp_path / "verdicts.csv"
    done = judge(written(tmp_path / name, content), "--json", "--verdicts", verdicts)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.startswith(b"headway: ")
    assert done.stderr.count(b"\n") == 1
    assert words in done.stderr.decode()
    assert list(tmp_path.glob("verdicts*")) == []


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["absent.jsonl"], "absent.jsonl: No such file"),
        (["."], ".: Is a directory"),
        (["--format", "tape", "road.jsonl"], "--format tape: choose from auto, bsm, pcap"),
        (["road.jsonl", "--verdicts", "v.xlsx"], "--verdicts v.xlsx: choose the ending"),
        (["road.jsonl", "--set", "delay_s"], "--set delay_s: write it as KEY=VALUE"),
        (["road.jsonl", "--set", "dealy_s=1"], "unknown setting dealy_s: did you mean delay_s?"),
        (["road.jsonl", "--set", "delay_s=x"], "delay_s = 'x'"),
        (["road.jsonl", "--events", "/absent/e.jsonl"], "/absent/e.jsonl: No such file"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_status_2(
    recording: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], words: str
) -> None:
    monkeypatch.chdir(recording.parent)
    done = judge(*arguments)
    assert (done.returncode, done.stdout) == (2, b"")
    assert done.stderr.count(b"\n") == 1
    assert words in done.stderr.decode()


def test_the_summary_for_people_names_the_same_numbers(recording: Path) -> None:
    shown, done = summary(recording), judge(recording)
    text = done.stdout.decode()
    assert done.returncode == 0
    assert f"{shown['alarms']} alarms" in text
    assert "4 vehicles" in text
