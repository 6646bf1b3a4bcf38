"""What the command line says of itself."""

import os
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator

import click
import pytest
import typer
from typer.testing import CliRunner

from headway.cli.app import app

ROOT = typer.main.get_command(app)


def leaves(command: click.Command, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], click.Command]]:
    for name, inner in getattr(command, "commands", {}).items():
        if hasattr(inner, "commands"):
            yield from leaves(inner, (*words, name))
        else:
            yield (*words, name), inner


COMMANDS = dict(leaves(ROOT))


def example_of(command: click.Command) -> list[str]:
    found = re.search(r"Example: ([^\n]+)", command.help or "")
    assert found, command.name
    return shlex.split(found[1])


@pytest.mark.parametrize("words", COMMANDS)
def test_every_help_text_holds_an_example_that_the_command_takes(words: tuple[str, ...]) -> None:
    example = example_of(COMMANDS[words])
    start = example.index("headway")
    assert tuple(example[start + 1 :][: len(words)]) == words
    arguments = example[start + 1 + len(words) :]
    end = next((i for i, word in enumerate(arguments) if word in {">", "|"}), len(arguments))
    COMMANDS[words].make_context(words[-1], arguments[:end])


@pytest.mark.parametrize("words", [(), ("alerts",), *COMMANDS])
@pytest.mark.parametrize("columns", [60, 80, 160])
def test_h_is_help_and_fits_the_terminal(words: tuple[str, ...], columns: int) -> None:
    result = CliRunner().invoke(app, [*words, "-h"], env={"COLUMNS": str(columns), "TERMINAL_WIDTH": str(columns)})
    assert result.exit_code == 0
    assert "Example: headway" in " ".join(result.output.split()) or words in {("alerts",), ("serve",)}
    assert max(map(len, result.output.splitlines())) <= columns


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_shells_complete_commands_and_options(shell: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION", "1")  # whatever shell runs the tests

    def completed(line: str) -> str:
        words = {
            "bash": {"COMP_WORDS": line, "COMP_CWORD": str(len(line.split(" ")) - 1)},
            "zsh": {"_TYPER_COMPLETE_ARGS": line},
            "fish": {"_TYPER_COMPLETE_ARGS": line, "_TYPER_COMPLETE_FISH_ACTION": "get-args"},
        }[shell]
        code = "import sys; sys.argv = ['headway']; from headway.cli.app import main; main()"
        environment = os.environ | {"_HEADWAY_COMPLETE": f"complete_{shell}", **words}
        ended = subprocess.run(
            [sys.executable, "-c", code], check=False, env=environment, stdout=subprocess.PIPE, text=True
        )
        return ended.stdout

    assert "_HEADWAY_COMPLETE" in CliRunner().invoke(app, ["--show-completion", shell], prog_name="headway").output
    commands = completed("headway re")
    assert "replay" in commands
    assert "watch" not in commands
    assert "--inject" in completed("headway replay --inj")
