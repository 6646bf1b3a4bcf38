"""A hook of mkdocs: the page of the command line is made from the commands themselves."""

import re
from collections.abc import Iterator

import click
import typer
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files

from headway.cli.app import app

PAGE = "reference/cli.md"


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the page."""
    files.append(File.generated(config, PAGE, content="\n".join(page())))
    return files


def page() -> Iterator[str]:
    """Yield the lines of the page."""
    yield "# Command line"
    yield ""
    yield "Each command with its options, as `-h` shows them. A setting is an option of no command; see"
    yield "[Operations](../OPERATIONS.md#settings)."
    yield from _command(typer.main.get_command(app), "headway")


def _command(command: click.Command, path: str) -> Iterator[str]:
    subcommands = getattr(command, "commands", {})
    if not subcommands:
        yield from ("", f"## `{path}`", "", _paragraphs(command.help), "")
        yield from _options(command)
    for name, subcommand in subcommands.items():
        yield from _command(subcommand, f"{path} {name}")


def _paragraphs(text: str | None) -> str:
    """Return a help text in Markdown; a line of it is an example."""
    return re.sub(r"^Example: (.+)$", r"Example: `\1`", text or "", flags=re.MULTILINE)


def _options(command: click.Command) -> Iterator[str]:
    rows = [parameter for parameter in command.params if parameter.name != "help"]
    if rows:
        yield from ("| option | is |", "| --- | --- |")
    for parameter in rows:
        names = ", ".join(f"`{name}`" for name in parameter.opts)
        text = getattr(parameter, "help", None) or ""
        yield f"| {names} | {text.replace('|', chr(92) + '|')} |"
