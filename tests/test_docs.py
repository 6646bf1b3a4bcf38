"""The documentation: its commands are commands, its Python runs, and the tutorial does what it says."""

import re
import shlex
import shutil
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import click
import pytest
import typer

from headway import Detector, sample_recording
from headway.cli.app import app
from headway.edge.storage.journal import EventUpdate, Journal

DOCS = Path(__file__).parents[1] / "docs"
TUTORIAL = (DOCS / "start" / "tutorial.md").read_text()
MOTION_MODEL = (DOCS / "howto" / "motion_model.md").read_text()
PAGES = sorted(page for page in DOCS.rglob("*.md") if "adr" not in page.parts)


def blocks(page: str, language: str = "") -> list[str]:
    """Return the fenced blocks of a language, without their indentation."""
    found = re.findall(r"^( *)```(\w*)\n(.*?)^ *```$", page, re.MULTILINE | re.DOTALL)
    return [re.sub(rf"^{indent}", "", text, flags=re.MULTILINE) for indent, of, text in found if of == language]


def commands(page: Path) -> list[str]:
    """Return the lines of blocks that call headway, without what goes before the name."""
    lines = [line for block in blocks(page.read_text()) for line in block.replace("\\\n", " ").splitlines()]
    found = [re.match(r"(?:[A-Z_]+=\S+ )*(?:\S+/bin/)?(headway .*)", line) for line in lines]
    return [one[1] for one in found if one]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_the_commands_of_a_page_are_commands_with_these_options(page: Path) -> None:
    for line in commands(page):
        words = shlex.split(line.partition(" | ")[0].partition(" > ")[0], comments=True)[1:]
        command: click.Command = typer.main.get_command(app)
        while words and words[0] in getattr(command, "commands", {}):
            command = command.commands[words.pop(0)]  # type: ignore[attr-defined]
        assert not hasattr(command, "commands") or words in (["-h"], ["--help"]), line
        known = {name for parameter in command.params for name in parameter.opts} | {"-h", "--help"}
        options = {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)}
        assert options <= known, line


def run(*words: str, folder: Path) -> str:
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_tutorial_finds_the_fault_of_its_own_recording(tmp_path: Path) -> None:
    make_drive, in_python = blocks(TUTORIAL, "python")
    (tmp_path / "make_drive.py").write_text(make_drive)
    make, judge = next(block for block in blocks(TUTORIAL) if "make_drive.py" in block).splitlines()
    assert make == "python make_drive.py"
    run("make_drive.py", folder=tmp_path)
    summary = run("-m", *shlex.split(judge), folder=tmp_path)
    assert "1,800 records" in summary
    assert "1 alarms" in summary
    assert "bias: 1" in summary
    events = (tmp_path / "events.jsonl").read_text()
    assert '"suspect":"blue"' in events
    assert '"sensor":"location"' in events
    assert len((tmp_path / "verdicts.csv").read_text().splitlines()) == 1 + 1_800
    assert run("-c", in_python, folder=tmp_path).strip() == "[('blue', 'location')]"
    assert f"It prints `{run('-c', in_python, folder=tmp_path).strip()}`" in TUTORIAL
    assert (tmp_path / "blue.png").stat().st_size > 10_000


def test_the_python_of_the_guide_to_models_runs(tmp_path: Path) -> None:
    (code,) = blocks(MOTION_MODEL, "python")
    assert [line.split()[0] for line in run("-c", code, folder=tmp_path).splitlines()] == ["ekf", "headway"]


def test_the_guide_to_certificates_makes_a_bus_that_is_of_one_authority(tmp_path: Path) -> None:
    (tmp_path / "deploy").symlink_to(DOCS.parent / "deploy")
    steps = [
        block for block in blocks((DOCS / "howto" / "certificates.md").read_text()) if "headway dashboard" not in block
    ]
    done = subprocess.run(
        ["bash", "-euc", "\n".join(steps)], cwd=tmp_path, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.count(": OK") == 5
    assert "notAfter=" in done.stdout
    assert '"cert_common_names":' in (tmp_path / "router.json5").read_text().replace(
        "cert_common_names:", '"cert_common_names":'
    )


def test_the_guide_to_export_reads_a_journal(tmp_path: Path) -> None:
    path = tmp_path / "journal.sqlite"
    found = Detector().process(sample_recording()).events
    now_us = time.time_ns() // 1000
    journal = Journal(path, site="local", instance="a", days=30.0, megabytes=100.0)
    dated = [event.model_copy(update={"detected_us": now_us}) for event in found]
    journal.write([EventUpdate(event, "", event.model_dump_json().encode()) for event in dated])
    page = (DOCS / "howto" / "export.md").read_text()
    to_files, in_sql = blocks(page)
    for line in to_files.splitlines():
        run("-m", *shlex.split(line), "--journal", str(path), folder=tmp_path)
    with sqlite3.connect(path) as db:
        (stored,) = db.execute("SELECT count(*) FROM updates").fetchone()
    assert len((tmp_path / "alerts.jsonl").read_text().splitlines()) == stored
    assert len((tmp_path / "alerts.csv").read_text().splitlines()) == 1 + stored
    assert (tmp_path / "alerts.parquet").exists()
    for line in in_sql.splitlines():
        with sqlite3.connect(path) as db:
            assert db.execute(shlex.split(line)[-1]).fetchall()
    (code,) = blocks(page, "python")
    first = run("-c", code, folder=tmp_path).splitlines()[0]
    assert re.fullmatch(r"\S+ \d+ \['t_s', 'x_m', \S+\]", first)


def test_the_check_fails_on_a_page_that_the_navigation_lacks(tmp_path: Path) -> None:
    makefile = (DOCS.parent / "Makefile").read_text().partition("\ncheck:")[2]
    build = next(line.split()[1:] for line in makefile.splitlines() if line.startswith("\t$(BIN)/mkdocs"))
    shutil.copytree(DOCS, tmp_path / "docs")
    shutil.copy(DOCS.parent / "mkdocs.yml", tmp_path)
    run("-m", "mkdocs", *build, folder=tmp_path)
    (tmp_path / "docs" / "orphan.md").write_text("# Of no part\n")
    done = subprocess.run(
        [sys.executable, "-m", "mkdocs", *build], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode != 0
    assert "orphan.md" in done.stderr
