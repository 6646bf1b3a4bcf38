"""The command on a small recording: the contract of its JSON, and refusals in one line."""

import json

import numpy as np
import pytest
from loadtest.evaluate.field.made import driving

from headway.core.runtime import bound_kernel
from headway_loadtest.evaluate.field.command import evaluate_field
from headway_loadtest.evaluate.field.experiment import FieldProtocol


@pytest.fixture(autouse=True)
def _unchecked_kernels(monkeypatch):
    """Thousands of steps: their arguments are checked in the tests of the core."""
    monkeypatch.setattr(bound_kernel, "check_arguments", False)


@pytest.fixture
def recording(tmp_path):
    folder = tmp_path / "made"
    folder.mkdir()
    rows = ["t_s,id,lat,lon,speed_mps,heading_deg"]
    rng = np.random.default_rng(0)
    messages = driving(seconds=80.0).messages
    for k, one in enumerate(messages):
        speed = one["speed_mps"] + rng.normal(0.0, 0.01)
        rows.append(f"{k / 10:.1f},a,{one['lat_deg']:.9f},{one['lon_deg']:.9f},{speed:.3f},0.0")
    (folder / "one.csv").write_text("\n".join(rows))
    return folder


def test_rows_have_the_promised_keys_and_the_report_is_written(recording, tmp_path, capsys):
    protocol = FieldProtocol(severities=(1.0,), runs=2)
    assert evaluate_field([str(recording)], protocol, as_json=True, out=tmp_path / "out", processes=1) == 0
    result = json.loads(capsys.readouterr().out)
    (row,) = result["rows"]
    assert row.keys() >= {
        "set",
        "vehicle_hours",
        "false_alarms_per_hour",
        "link_false_alarms_per_pair_hour",
        "severity",
        "recall",
        "kind_correct",
        "sensor_correct",
    }
    assert (row["set"], row["severity"], row["false_alarms"]) == ("made", 1.0, 0)
    assert row["vehicle_hours"] == pytest.approx(79.9 / 3600.0)
    assert row["recall"] > 0.8
    assert result["degradations"] == result["attacks"] == []
    assert "| made | 1 |" in (tmp_path / "out" / "report.md").read_text()
    assert json.loads((tmp_path / "out" / "result.json").read_text()) == result


def test_degradations_and_attacks_have_the_promised_keys(recording, capsys):
    protocol = FieldProtocol(severities=(1.0,), runs=1, degrade=True, attacks=("zero-speed",))
    assert evaluate_field([str(recording)], protocol, as_json=True, processes=1) == 0
    result = json.loads(capsys.readouterr().out)
    by_name = {row["degradation"]: row for row in result["degradations"]}
    assert by_name["jump-along"]["jump_recall"] > 0.5
    assert by_name["walk-1m"]["jump_recall"] is None
    assert [row["onset"] for row in result["attacks"]] == ["birth", "mid"]
    promised = {"attack", "onset", "message_recall", "event_recall", "false_positive_rate", "suspect_correct"}
    assert all(row.keys() >= promised for row in result["attacks"])
    assert result["attacks"][1]["message_recall"] > 0.5


@pytest.mark.parametrize(
    ("sources", "protocol", "said"),
    [
        (["nowhere"], FieldProtocol(), "nowhere: no recording"),
        (["nowhere"], FieldProtocol(severities=()), "--severity takes variances"),
        (["sumo:rural"], FieldProtocol(), "sumo:rural: no such traffic"),
        (["nowhere"], FieldProtocol(attacks=("zero",)), "--attack takes words of"),
        (["nowhere"], FieldProtocol(budget_per_hour=0.0), "--budget is false alarms"),
    ],
)
def test_refusals_are_one_line(sources, protocol, said, capsys):
    assert evaluate_field(sources, protocol) == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert said in line
