"""The evaluation end to end, on a pair that the test writes itself; and on real ones where they are at hand."""

import json
from itertools import pairwise

import numpy as np
import pytest

from headway.core.estimation import registry
from headway.core.types.config import DetectorConfig
from headway_loadtest.evaluate.pairs.command import evaluate_pairs
from headway_loadtest.evaluate.pairs.drive import injected_drives, load, run_model
from headway_loadtest.evaluate.pairs.experiment import PairsProtocol, run_pairs
from headway_loadtest.inject.faults import Kind
from headway_loadtest.sources.drive import SourceError

HEADER = "t_s,leader_x_m,follower_x_m,leader_v_mps,follower_v_mps,leader_length_m"
QUICK = PairsProtocol(models=("ca", "headway"), delays_s=(0.5,), severities=(1.0,), runs=1)


@pytest.fixture(scope="module")
def pair_file(tmp_path_factory):
    """Two cars, ten minutes: the follower does what the leader did two seconds ago."""
    t_s = 0.1 * np.arange(6101)
    v = 11.0 + 3.0 * np.sin(0.11 * t_s) + 1.5 * np.sin(0.37 * t_s)
    x = np.r_[0.0, np.cumsum(0.05 * (v[1:] + v[:-1]))]
    late = 20
    columns = [t_s[late:], x[late:] + 15.0, x[:-late], v[late:], v[:-late], np.full(len(t_s) - late, 4.5)]
    path = tmp_path_factory.mktemp("made") / "pair.csv"
    np.savetxt(path, np.stack(columns, axis=1), fmt="%.4f", delimiter=",", header=HEADER, comments="")
    return path


@pytest.fixture(scope="module")
def result(pair_file):
    return run_pairs([pair_file], QUICK)


def test_a_row_for_each_set_model_delay_severity_and_kind(result) -> None:
    keys = [(row["set"], row["model"], row["delay_s"], row["severity"], row["kind"]) for row in result["rows"]]
    assert keys == [(keys[0][0], "ca", 0.5, 1.0, "all"), (keys[0][0], "headway", 0.5, 1.0, "all")]
    assert {row["set"] for row in result["clean"]} == {keys[0][0], "all"}
    json.dumps(result, allow_nan=False)


def test_what_a_model_is_warmed_up_for_is_what_a_drive_needs(pair_file) -> None:
    """Else each process compiles for itself, into one cache; the delay is one that no other test has."""
    model = registry.build(DetectorConfig(model="ekf", delay_s=0.3))
    model.warm_up()
    warm = list(model.step_batch.signatures)
    pair = load(pair_file)
    run_model(model, pair, injected_drives(pair, 0, (1.0,), ("all",), 1, 0), 0)
    assert model.step_batch.signatures == warm


def test_the_default_model_finds_nearly_all_on_an_easy_road(result) -> None:
    ca, headway = result["rows"]
    assert headway["recall_at_budget"] > 0.9
    assert headway["share_of_ceiling"] > 0.95
    assert headway["kind_correct"] > 0.75
    assert headway["recovered_share_location"] < 0.2
    assert headway["recovered_share_location"] < ca["recovered_share_location"]
    assert headway["gate"] is None
    assert ca["gate"] > 0.0


def test_models_hear_the_same_story(result, pair_file) -> None:
    ca, headway = result["rows"]
    assert ca["ceiling"] == headway["ceiling"]
    assert ca["events"] == headway["events"]
    assert ca["corrupted_rmse_m"] == headway["corrupted_rmse_m"]


def test_the_same_seed_gives_the_same_numbers_in_one_process_or_two(result, pair_file) -> None:
    assert run_pairs([pair_file], QUICK, processes=2) == result


def test_a_single_kind_can_be_asked_for(pair_file) -> None:
    pair = load(pair_file)
    drives = injected_drives(pair, 0, (0.5,), ("bias", "short"), 1, 0)
    assert [(one.severity, one.kind) for one in drives] == [(0.0, "none"), (0.5, "bias"), (0.5, "short")]
    assert not drives[0].corrupted.events
    assert {event.kind for event in drives[1].corrupted.events} == {Kind.BIAS}
    assert {event.kind for event in drives[2].corrupted.events} == {Kind.SHORT}


def test_a_short_pair_is_driven_more_than_once_and_lied_about_anew(pair_file, tmp_path) -> None:
    short = tmp_path / "short.csv"
    short.write_text("\n".join(pair_file.read_text().splitlines()[:1200]), encoding="utf-8")
    drives = injected_drives(load(short), 0, (), (), 1, 0)
    assert len(drives) == 6
    for one, other in pairwise(drives):
        assert (one.corrupted.x_m != other.corrupted.x_m).all()


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"models": ("ekg",)}, "--models"),
        ({"kinds": ("drag",)}, "--kinds"),
        ({"severities": (0.0,)}, "--severity"),
        ({"delays_s": (-1.0,)}, "--delay"),
        ({"runs": 0}, "--runs"),
        ({"budget_per_hour": 0.0}, "budget"),
    ],
)
def test_an_option_that_cannot_be_is_one_line_and_status_2(pair_file, capsys, changes, word: str) -> None:
    assert evaluate_pairs([pair_file], PairsProtocol(**changes)) == 2
    named = capsys.readouterr().err.strip()
    assert word in named
    assert "\n" not in named


def test_a_file_that_is_not_there_is_named(tmp_path, capsys) -> None:
    assert evaluate_pairs([tmp_path / "nowhere.csv"], QUICK) == 2
    assert "nowhere.csv" in capsys.readouterr().err
    with pytest.raises(SourceError, match="no pair file"):
        run_pairs([tmp_path], QUICK)


def test_json_alone_on_standard_output_and_a_report_in_the_folder(pair_file, tmp_path, capsys) -> None:
    out = tmp_path / "report"
    assert evaluate_pairs([pair_file], QUICK, as_json=True, out=out, processes=1) == 0
    assert json.loads(capsys.readouterr().out)["runs"] == 1
    report = (out / "report.md").read_text(encoding="utf-8")
    for name in ("recall.png", "share.png", "drive.png"):
        assert f"({name})" in report
        assert (out / name).stat().st_size > 5_000


def test_real_followers_are_judged_within_budget_and_found(shared_data) -> None:
    """One human platoon: enough to notice a broken model, not to measure one."""
    folder = shared_data / "pairs" / "jiang"
    result = run_pairs([folder], PairsProtocol(models=("headway",), delays_s=(0.5,), severities=(1.0,), runs=1))
    (row,) = result["rows"]
    assert row["recall_at_budget"] > 0.93
    assert row["share_of_ceiling"] > 0.94
    assert row["kind_correct"] > 0.8
    assert row["false_alarms_per_hour"] < 4.0
