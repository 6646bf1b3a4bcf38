"""`headway alerts`: identifiers whole, times in words that people use, files by their ending and not overwritten."""

import csv
import io
import json
import time
from pathlib import Path

import pytest
from edge.storage.updates import update
from rich.console import Console
from sim.rig import IDENTITY
from typer.testing import CliRunner

from headway.cli.app import app
from headway.cli.run.alerts import print_table, query
from headway.cli.run.alerts_export import write_csv
from headway.edge.storage.handling_store import store
from headway.edge.storage.journal import Journal
from headway.errors import UserError
from headway_schemas.handling import Action, Handling

LONG_ID = "main-street-north-onboard-unit-00012345-1700000000000000-bias"
HOUR_US = 3_600_000_000


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    file = tmp_path / "journal.sqlite"
    now_us = time.time_ns() // 1000
    ages_us = (26 * HOUR_US, 2 * HOUR_US, 30_000_000)
    Journal(file, site=IDENTITY.site, instance=IDENTITY.instance, days=30.0, megabytes=100.0).write(
        [
            update(now_us - age_us, event_id=f"{LONG_ID}-{i}", onset_us=now_us - age_us)
            for i, age_us in enumerate(ages_us)
        ]
    )
    return file


def invoke(*args: object, **options: object) -> str:
    result = CliRunner().invoke(app, ["alerts", *map(str, args)], **options)  # type: ignore[arg-type]
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.stdout


@pytest.mark.parametrize("columns", ["20", "80"])
def test_a_pipe_gets_whole_lines_with_columns_apart_by_tabs(journal: Path, columns: str) -> None:
    lines = invoke("list", "--journal", journal, env={"COLUMNS": columns}).splitlines()
    assert [line.split("\t")[0] for line in lines] == [f"{LONG_ID}-{i}" for i in range(3)]
    assert all(line.split("\t")[2:6] == ["onset", "bias", "location", "car1"] for line in lines)


@pytest.mark.parametrize("width", [20, 80, 100, 160])
def test_a_terminal_gets_the_columns_that_fit_and_the_id_always(width: int) -> None:
    row = {"event": LONG_ID, "detected": "2024-05-01T12:00:00.000Z", "kind": "feigned-brake", "suspect": "s" * 20}
    console = Console(file=io.StringIO(), width=width)
    print_table([row], console)
    text = console.file.getvalue()  # type: ignore[attr-defined]
    assert LONG_ID in text
    assert "…" not in text
    for name in ("detected", "kind", "suspect"):
        assert (row[name] in text) != (name in text.partition("not shown")[2])
    assert (row["suspect"] in text) == (width == 160)
    assert max(len(line) for line in text.partition("not shown")[0].splitlines()) <= max(width, len(LONG_ID))


def test_how_a_vehicle_is_handled_is_listed_with_its_events(journal: Path) -> None:
    now_us = time.time_ns() // 1000
    of = {"site": IDENTITY.site, "vehicle": "car1", "by": "anna", "t_us": now_us - HOUR_US}
    store(journal, Handling(action=Action.RESOLVE, **of))
    store(journal, Handling(action=Action.NOTE, note="antenna\tloose", **of))
    shown = [line.split("\t", 8)[-1] for line in invoke("list", "--journal", journal).splitlines()]
    assert shown == ["resolved by anna; anna: antenna loose"] * 2 + ["anna: antenna loose"]
    listed = json.loads(invoke("list", "--journal", journal, "--json"))
    assert [one["action"] for one in listed["handlings"]] == ["resolve", "note"]


def test_no_alerts_are_an_empty_list(tmp_path: Path) -> None:
    print_table([], console := Console(file=io.StringIO(), width=80))
    assert console.file.getvalue().strip() == "no events"  # type: ignore[attr-defined]


@pytest.mark.parametrize(("ago", "count"), [("-1m", 1), ("-90s", 1), ("-1.5h", 1), ("-3h", 2), ("-2d", 3)])
def test_times_may_be_relative(journal: Path, ago: str, count: int) -> None:
    listed = json.loads(invoke("list", "--journal", journal, "--from", ago, "--json"))["alerts"]
    assert len(listed) == count
    before = json.loads(invoke("list", "--journal", journal, "--to", ago, "--json"))["alerts"]
    assert len(before) == 3 - count


def test_a_time_of_day_is_utc_unless_it_says() -> None:
    assert query(from_time="2024-05-01T12:00:00", to_time=None).from_us == 1_714_564_800_000_000
    assert query(from_time="2024-05-01T12:00:00+02:00", to_time=None).from_us == 1_714_557_600_000_000
    with pytest.raises(UserError, match="-1h for an hour ago"):
        query(from_time="-1 fortnight", to_time=None)


def test_the_ending_of_the_file_says_the_format(journal: Path, tmp_path: Path) -> None:
    table = tmp_path / "alerts.csv"
    invoke("export", table, "--journal", journal)
    with table.open(newline="") as file:
        assert [row["event_id"] for row in csv.DictReader(file)] == [f"{LONG_ID}-{i}" for i in range(3)]
    text = tmp_path / "alerts.txt"
    with pytest.raises(UserError, match=r"alerts.txt: choose jsonl, csv or parquet"):
        invoke("export", text, "--journal", journal)
    invoke("export", text, "--format", "jsonl", "--journal", journal)
    assert len(text.read_text().splitlines()) == 3
    assert invoke("export", "--journal", journal) == text.read_text()


def test_an_id_is_no_formula_of_a_spreadsheet() -> None:
    row = {"event_id": "-2+3", "suspect": "a-1", "t_us": -5, "evidence": None}
    out = io.BytesIO()
    assert write_csv([json.dumps(row).encode()], out) == 1
    assert out.getvalue().decode().splitlines()[1] == "'-2+3,a-1,-5"


def test_a_file_is_not_overwritten_unasked(journal: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "alerts.csv"
    out.write_text("precious")
    with pytest.raises(UserError, match="--force overwrites it"):
        invoke("export", out, "--journal", journal)
    monkeypatch.setattr("headway.cli.alerts.interactive", lambda: True)
    invoke("export", out, "--journal", journal, input="n\n")
    assert out.read_text() == "precious"
    invoke("export", out, "--journal", journal, input="y\n")
    assert LONG_ID in out.read_text()
    out.write_text("less precious")
    invoke("export", out, "--journal", journal, "--force")
    assert LONG_ID in out.read_text()
