"""Recordings of other systems for `headway evaluate field`: one for each drive, with the numbers of the file."""

import json
from pathlib import Path

import numpy as np
import pytest
from gateways.recordings.made_files import (
    ABSOLUTE_US,
    BSM_P1_HEADER,
    MADE,
    READINGS,
    STEPS,
    Reading,
    bsm_p1_row,
    veremi_message,
)
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.recorded.field_reader import FieldReader
from headway_loadtest.evaluate.field.recordings import load, load_recorded

READER = FieldReader()


@pytest.mark.parametrize("name", [name for name in MADE if name != "gnss.csv"])
def test_every_format_has_the_numbers_of_the_file(tmp_path: Path, name: str) -> None:
    path, made = tmp_path / name, MADE[name]
    made.write(path)
    assert READER.recognises(path)
    [(recording, malicious)] = load_recorded([path], READER)
    assert (malicious is not None) == (name == "nextgen.json")
    assert sorted(recording.vehicles) == list(made.ids)
    for vehicle, track in zip(recording.vehicles, recording.tracks, strict=True):
        mine = [one for one in READINGS if made.ids[one.car - 1] == vehicle]
        assert track["t_us"].tolist() == [made.start_us + one.step * 100_000 for one in mine]
        assert track["speed_mps"] == pytest.approx([one.speed_mps for one in mine], abs=0.011)
        assert track["lat_deg"] == pytest.approx([one.lat for one in mine], abs=1e-7)


def test_the_formats_of_the_evaluation_are_its_own(tmp_path: Path) -> None:
    path = tmp_path / "gnss.csv"
    MADE["gnss.csv"].write(path)
    assert not READER.recognises(path)
    (recording,) = load(path, 1, 0)
    assert len(recording.messages) == len(READINGS)


def test_days_are_recordings_of_their_own(tmp_path: Path) -> None:
    path = tmp_path / "BsmP1.csv"
    rows = [bsm_p1_row(one, us=ABSOLUTE_US + day * 86_400_000_000) for one in READINGS for day in (0, 1)]
    path.write_text("\n".join([BSM_P1_HEADER, *rows]))
    for recording, _ in load_recorded([path], READER):
        assert np.bincount(recording.messages["vehicle"]).tolist() == [STEPS, STEPS]
        assert np.ptp(recording.messages["t_us"]) == (STEPS - 1) * 100_000


def test_the_command_takes_them(tmp_path: Path) -> None:
    folder = tmp_path / "set"
    folder.mkdir()
    for name in ("fcd-local.xml", "ode.json", "gnss.csv"):
        MADE[name].write(folder / name)
    (folder / "README.txt").write_text("notes")
    ran = CliRunner().invoke(
        app, ["evaluate", "field", str(folder), "--json", "--runs", "1", "--severity", "1", "--jobs", "1"]
    )
    assert ran.exit_code == 0, ran.output
    (row,) = json.loads(ran.stdout)["rows"]
    assert row["set"] == "set"
    assert row["vehicle_hours"] == pytest.approx(3 * 2 * (STEPS - 1) / 10 / 3600, abs=1e-3)


def _evaluated(folder: Path) -> dict:
    options = ["--json", "--runs", "1", "--severity", "1", "--jobs", "1"]
    ran = CliRunner().invoke(app, ["evaluate", "field", str(folder), *options])
    assert ran.exit_code == 0, ran.output
    result: dict = json.loads(ran.stdout)
    return result


def test_ground_truth_is_scored_and_not_shown_to_the_detector(tmp_path: Path) -> None:
    """A car that sends the speed of 80 m/s is found, whatever the labels say; they decide what that counts as."""
    folder, minutes = tmp_path / "veremi", 20
    folder.mkdir()
    messages = [veremi_message(Reading(car, step)) for step in range(minutes * STEPS) for car in (1, 2)]
    for message in messages:
        if message["sender"] == 2:
            message["spd"] = [0.0, 80.0, 0.0]
    (folder / "JSONlog-0-7-A1.json").write_text("\n".join(map(json.dumps, messages)))

    def labels(attacker: int) -> str:
        rows = [
            {"type": 4, "time": m["sendTime"], "sender": m["sender"], "messageID": m["messageID"],
             "attackerType": 4 if m["sender"] == attacker else 0}
            for m in messages
        ]  # fmt: skip
        return "\n".join(map(json.dumps, rows))

    truth = folder / "GroundTruthJSONlog.json"
    truth.write_text(labels(2))
    right = _evaluated(folder)
    truth.write_text(labels(1))
    (mislabelled,) = _evaluated(folder)["attacks"]
    (row,) = right["attacks"]
    assert right["rows"] == []
    assert (row["set"], row["attack"], row["onset"]) == ("veremi", "ground truth", "recorded")
    assert row["messages"] == mislabelled["messages"] == minutes * STEPS
    assert row["message_recall"] > 0.9
    assert (row["event_recall"], row["false_positive_rate"], row["honest_cars_named"]) == (1.0, 0.0, 0)
    assert mislabelled["message_recall"] == row["false_positive_rate"]
    assert mislabelled["false_positive_rate"] == row["message_recall"]
