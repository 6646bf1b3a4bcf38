"""`headway evaluate paper` from options to exit code: one JSON object, or tables; one line for what is wrong."""

import json
from pathlib import Path

import pytest

from headway_loadtest.evaluate.paper.command import evaluate_paper
from headway_loadtest.evaluate.paper.experiment import DEVIATIONS, Protocol
from headway_loadtest.evaluate.paper.loop import Recovery

SMALL = Protocol(runs=1)


def test_json_is_all_there_is_on_standard_output(leader_csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert evaluate_paper(leader_csv, SMALL, as_json=True, processes=1) == 0
    printed = json.loads(capsys.readouterr().out)
    assert {
        "table1",
        "table2",
        "seeds",
        "mean_absolute_deviation",
        "recovery",
        "history",
        "deviations",
    } <= printed.keys()


def test_a_reader_gets_both_recoveries_and_the_printed_values(leader_csv: Path, capsys, monkeypatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    assert evaluate_paper(leader_csv, SMALL, processes=1) == 0
    out = capsys.readouterr().out
    for recovery in Recovery:
        assert f"Recovery: {recovery}" in out
    for printed in ("0.984", "0.731", "-0.436"):
        assert printed in out
    assert out.count("Table 2") == 1


def test_a_report_holds_every_figure_and_every_deviation(leader_csv: Path, tmp_path: Path, capsys) -> None:
    out = tmp_path / "new" / "report"
    assert evaluate_paper(leader_csv, SMALL, as_json=True, out=out, processes=1) == 0
    text = (out / "report.md").read_text(encoding="utf-8")
    for name in DEVIATIONS:
        assert f"**{name}**" in text
    figures = sorted(path.name for path in out.glob("*.png"))
    assert figures == ["innovations.png", "roc-ground-truth.png", "run.png"]
    for name in figures:
        assert f"({name})" in text
        assert 5_000 < (out / name).stat().st_size < 80_000


@pytest.mark.parametrize(
    ("protocol", "message"),
    [
        (Protocol(runs=0), "--runs must be 1 or more, not 0"),
        (Protocol(delay_jitter_s=-0.1), "--delay-jitter is in s, 0 to 1, not -0.1"),
        (Protocol(delay_jitter_s=float("nan")), "--delay-jitter is in s, 0 to 1, not nan"),
    ],
)
def test_an_option_that_cannot_be_gets_one_line(leader_csv: Path, capsys, protocol: Protocol, message: str) -> None:
    assert evaluate_paper(leader_csv, protocol) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err == f"headway evaluate paper: {message}\n"


def test_a_bad_leader_file_gets_one_line_and_nothing_else(leader_csv: Path, capsys) -> None:
    leader_csv.write_text("t_s,x_m\n0,0\n", encoding="utf-8")
    assert evaluate_paper(leader_csv, SMALL) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.count("\n") == 1
    assert "no column v_mps" in output.err


def test_a_report_into_a_file_is_refused(leader_csv: Path, capsys) -> None:
    assert evaluate_paper(leader_csv, SMALL, out=leader_csv) == 2
    assert "--out must be a folder" in capsys.readouterr().err
