"""The README: its commands are commands, and its first replay has one car in twenty-five faulty."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import click
import pytest
import typer

from headway.cli.app import app
from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.replay import Request, frames_of

README = (Path(__file__).parents[1] / "README.md").read_text()
COMMANDS = [shlex.split(line, comments=True) for line in re.findall(r"(?:^|`)(headway [^`\n]+)", README, re.MULTILINE)]


@pytest.mark.parametrize("words", COMMANDS, ids=" ".join)
def test_a_command_of_the_readme_is_one(words: list[str]) -> None:
    command: click.Command = typer.main.get_command(app)
    arguments = words[1:]
    while arguments and arguments[0] in getattr(command, "commands", {}):
        command = command.commands[arguments.pop(0)]  # type: ignore[attr-defined]
    assert not hasattr(command, "commands") or arguments[0].startswith("-")
    if len(words) > 2 and words[1] != "evaluate":
        command.make_context(words[1], arguments, resilient_parsing=False)


def test_the_first_replay_has_one_car_in_twenty_five_faulty() -> None:
    words = next(words for words in COMMANDS if words[1] == "replay")
    options = dict(zip(words[3::2], words[4::2], strict=True))
    frames, _ = frames_of(
        Request(Reading([words[2]]), "local", 1.0, options["--inject"], int(options["--seed"]), 600.0)
    )
    assert 25 * len({label.vehicle for label in frames.labels}) == int(words[2].partition(":")[2])


def test_the_first_lines_of_python_print_the_events_of_the_sample() -> None:
    code = re.search(r"```python\n(.*?)```", README, re.DOTALL)
    assert code
    assert len(code[1].strip().splitlines()) <= 5
    done = subprocess.run([sys.executable, "-c", code[1]], capture_output=True, text=True, check=True)
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0][0] == "onset"
    assert lines[-1][0] == "cleared"
    assert {line[2] for line in lines} == {"speed"}
    assert {line[3] for line in lines} == {"car-2"}
