"""Recordings of other systems for `headway evaluate field`: one for each drive, with the numbers of the file."""

import json
from pathlib import Path

import numpy as np
import pytest
from gateways.recordings.made_files import ABSOLUTE_US, BSM_P1_HEADER, MADE, READINGS, STEPS, bsm_p1_row
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.recorded.scenes import FieldReader
from headway_loadtest.evaluate.field.recordings import load, load_recorded

READER = FieldReader()


@pytest.mark.parametrize("name", [name for name in MADE if name != "gnss.csv"])
def test_every_format_has_the_numbers_of_the_file(tmp_path: Path, name: str) -> None:
    path, made = tmp_path / name, MADE[name]
    made.write(path)
    assert READER.recognises(path)
    (recording,) = load_recorded(path, READER)
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
    for recording in load_recorded(path, READER):
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
