"""`headway judge` on recordings with oddities: each row is accounted for, and clean drives raise no alarm."""

import json
from pathlib import Path
from typing import Any

import pytest
from conftest import ROOT
from gateways.recordings.made_files import ABSOLUTE_US, BSM_P1_HEADER, READINGS, bsm_p1_row, veremi_message
from typer.testing import CliRunner

from headway.cli.app import app
from headway.detector import Detector

CASES = ROOT.parent / "shared" / "cases"


@pytest.fixture(scope="module", autouse=True)
def _kernels() -> None:
    Detector()


def judged(*arguments: str | Path) -> tuple[dict[str, Any], list[str]]:
    ran = CliRunner().invoke(app, ["judge", *map(str, arguments), "--json"])
    assert ran.exit_code == 0, ran.exception
    summary: dict[str, Any] = json.loads(ran.stdout)
    assert summary["records"] == sum(summary["outcomes"].values())
    return summary, ran.stderr.splitlines()


@pytest.mark.parametrize(
    ("name", "records", "refused"),
    [
        *((f"BsmP1_{name}", 800, {}) for name in (
            "ok.csv", "bom.csv", "crlf.csv", "gentime.csv", "nohead.csv", "nohead.csv.gz", "ok.csv.gz", "ok.parquet",
            "ok.zip", "quotedhead.csv", "semicolon.csv", "shuffled.csv", "spaces.csv", "sydney.csv", "tromso.csv",
            "trailingcomma.csv",
        )),
        ("BsmP1_noleader.csv", 400, {}),
        ("BsmP1_gap.csv", 541, {}),
        ("BsmP1_text.csv", 800, {"unavailable": 1}),
        ("BsmP1_nan.csv", 800, {"unavailable": 1}),
        ("BsmP1_mysqlnull.csv", 800, {"unavailable": 1}),
        ("BsmP1_negspeed.csv", 800, {"out_of_range": 1}),
        ("BsmP1_trunc.csv", 800, {"malformed": 1}),
    ],
)  # fmt: skip
def test_each_oddity_of_spmd_is_judged(name: str, records: int, refused: dict[str, int]) -> None:
    path = CASES / "files" / name
    if not path.is_file():
        pytest.skip(f"files as they are found are not at {CASES}")
    summary, lines = judged(path)
    assert (summary["records"], summary["alarms"]) == (records, 0)
    assert {word: n for word, n in summary["outcomes"].items() if word not in ("scored", "warming")} == refused
    assert len(lines) == len(refused)


def test_a_speed_that_leaves_the_positions_near_the_pole_is_found() -> None:
    """The file has a flat earth: within 20 s its positions come to move .35 m/s slower than its speeds say."""
    path = CASES / "files" / "BsmP1_pole.csv"
    if not path.is_file():
        pytest.skip(f"files as they are found are not at {CASES}")
    summary, lines = judged(path)
    assert (summary["records"], summary["alarms"], lines) == (800, 1, [])


@pytest.mark.parametrize(
    ("name", "records", "vehicles", "refused"),
    [
        ("fold_gz", 800, 2, {}),
        ("fold_lower", 800, 2, {}),
        ("fold_mixed", 800, 2, {}),
        ("fold_nested", 800, 2, {}),
        ("fold_upper", 800, 2, {}),
        ("spmd_bom", 400, 1, {}),
        ("spmd_crlf", 400, 1, {}),
        ("spmd_nan", 400, 1, {"unavailable": 2}),
        ("spmd_negspeed", 400, 1, {"out_of_range": 10}),
        ("spmd_ok", 400, 1, {}),
        ("spmd_rangetext", 400, 1, {}),
    ],
)
def test_each_folder_of_spmd_is_judged(name: str, records: int, vehicles: int, refused: dict[str, int]) -> None:
    path = CASES / "files" / name
    if not path.is_dir():
        pytest.skip(f"files as they are found are not at {CASES}")
    summary, lines = judged(path)
    assert (summary["records"], summary["vehicles"], summary["alarms"]) == (records, vehicles, 0)
    assert {word: n for word, n in summary["outcomes"].items() if word not in ("scored", "warming")} == refused
    assert len(lines) == sum(1 for _ in refused) + (name == "spmd_nan")


def test_every_other_file_is_judged() -> None:
    files = sorted((CASES / "other").glob("*"))
    if not files:
        pytest.skip(f"rows of other formats are not at {CASES}")
    for path in files:
        assert judged(path)[0]["records"] >= 1, path.name


def test_no_leader_is_of_another_day(tmp_path: Path) -> None:
    path, verdicts = tmp_path / "BsmP1.csv", tmp_path / "verdicts.jsonl"
    # Car 1 on one day, car 2 behind its place on the next.
    rows = [bsm_p1_row(one, us=ABSOLUTE_US + 86_400_000_000 * (one.car - 1)) for one in READINGS]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    summary, _ = judged(path, "--verdicts", verdicts)
    found = [json.loads(line) for line in verdicts.read_text().splitlines()]
    assert len(found) == summary["records"] == len(READINGS)
    assert {row["leader"] for row in found} == {None}
    path.write_text("\n".join([BSM_P1_HEADER, *map(bsm_p1_row, READINGS)]))
    judged(path, "--verdicts", verdicts)
    found = [json.loads(line) for line in verdicts.read_text().splitlines()]
    assert {row["leader"] for row in found} == {None, "1"}


def test_one_line_for_each_kind_of_thing_refused(tmp_path: Path) -> None:
    path = tmp_path / "BsmP1.csv"
    rows = [bsm_p1_row(one) for one in READINGS]
    for place in (3, 5, 7):
        rows[place] = rows[place].replace(f"{READINGS[place].speed_mps:.2f}", "N/A")
    rows[-1] = rows[-1][:40]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    summary, lines = judged(path)
    assert (summary["outcomes"]["unavailable"], summary["outcomes"]["malformed"]) == (3, 1)
    assert lines == [
        f"headway: {path}: 3 rows refused, first in line 5: unavailable: column Speed: no value",
        f"headway: {path}: line {len(rows) + 1} refused: malformed: another number of cells than the header has",
    ]


def test_a_mapped_table_in_mph_is_judged_as_in_metres_a_second(tmp_path: Path) -> None:
    path = tmp_path / "mine.csv"
    rows = [f"{one.car},{one.t_s * 1000:.0f},{one.lat:.9f},{one.lon},{one.speed_mps / 0.44704}" for one in READINGS]
    path.write_text("\n".join(["vehID,time,Latitude,Longitude,v", *rows]))
    columns = "id=vehID,t=time[ms],lat=latitude,lon=longitude,speed=v[mph]"
    assert judged(path, "--columns", columns)[0]["alarms"] == 0
    assert judged(path, "--columns", columns.replace("mph", "km/h"))[0]["alarms"] > 0


def test_ground_truth_is_scored_and_changes_no_verdict(tmp_path: Path) -> None:
    log, truth = tmp_path / "traceJSON-1.json", tmp_path / "GroundTruth.json"
    messages = [veremi_message(one) for one in READINGS]
    log.write_text("\n".join(map(json.dumps, messages)))
    labels = [
        {"type": 4, "time": m["sendTime"], "messageID": m["messageID"], "attackerType": int(m["sender"] == 2)}
        for m in messages
    ]
    truth.write_text("\n".join(map(json.dumps, labels)))
    alone, _ = judged(log)
    both, _ = judged(log, truth)
    assert both.pop("truth") == {
        "messages": len(READINGS),
        "attacks": len(READINGS) // 2,
        "recall": 0.0,
        "false_positive_rate": 0.0,
    }
    assert both == alone


def test_a_file_without_a_good_row_is_one_line_and_status_2(tmp_path: Path) -> None:
    path = tmp_path / "BsmP1.csv"
    path.write_text("\n".join([BSM_P1_HEADER, *(bsm_p1_row(one)[:40] for one in READINGS)]))
    ran = CliRunner().invoke(app, ["judge", str(path), "--json"])
    assert ran.stdout == ""
    assert str(ran.exception) == f"{path}: line 2: another number of cells than the header has; no row can be read"
