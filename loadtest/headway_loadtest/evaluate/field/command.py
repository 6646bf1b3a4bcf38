"""`headway evaluate field` without its command line: options in, tables out, an exit code back."""

import json
from collections.abc import Iterator, Sequence
from math import isfinite
from os import cpu_count
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from headway_loadtest.evaluate.field import sumo
from headway_loadtest.evaluate.field.attacks import ATTACKS
from headway_loadtest.evaluate.field.experiment import FieldProtocol, run_field
from headway_loadtest.evaluate.field.misbehaviour import Attacked, of_ground_truth
from headway_loadtest.evaluate.field.recordings import Bools, Reader, Recording, load, load_recorded
from headway_loadtest.evaluate.field.report import markdown, print_report
from headway_loadtest.evaluate.options import OptionError
from headway_loadtest.sources.drive import SourceError

BAD_INPUT = 2
FILE_WIDTH = 200
"""Columns of the report where standard output is not a terminal."""


def evaluate_field(
    sources: Sequence[str],
    protocol: FieldProtocol,
    *,
    minutes: float = 5.0,
    as_json: bool = False,
    out: Path | None = None,
    processes: int | None = None,
    reader: Reader | None = None,
) -> int:
    """Run the protocol and print it; return the exit code: 0, or 2 for input that cannot be used.

    `minutes` is how long simulated traffic lasts. `reader` reads recordings of other systems.
    """
    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        check(protocol, out)
        recordings, labelled = _recordings(sources, protocol, minutes, reader, stderr)
        result = _run(recordings, labelled, protocol, processes or cpu_count() or 1, stderr)
    except (SourceError, OptionError) as error:
        stderr.print(f"headway evaluate field: {error}", markup=False)
        return BAD_INPUT
    if as_json:
        print(json.dumps(result, allow_nan=False))  # noqa: T201 - standard output is the JSON
    else:
        console = Console()
        if not console.is_terminal:
            console.width = FILE_WIDTH
        print_report(result, console)
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        (out / "result.json").write_text(json.dumps(result, allow_nan=False, indent=1), encoding="utf-8")
        (out / "report.md").write_text(markdown(result), encoding="utf-8")
        stderr.print(f"report: {out / 'report.md'}", markup=False)
    return 0


def check(protocol: FieldProtocol, out: Path | None) -> None:
    """Raise OptionError for options that the evaluation cannot be run with."""
    if not protocol.severities or not all(isfinite(c) and c > 0.0 for c in protocol.severities):
        raise OptionError("--severity takes variances above 0, such as 1,0.5,0.1")
    if not protocol.budget_per_hour > 0.0:
        raise OptionError(f"--budget is false alarms per hour, above 0, not {protocol.budget_per_hour:g}")
    unknown = [name for name in protocol.attacks if name not in ATTACKS]
    if unknown:
        raise OptionError(f"--attack takes words of {', '.join(ATTACKS)}, not {', '.join(unknown)}")
    if out is not None and out.exists() and not out.is_dir():
        raise OptionError(f"--out must be a folder, and {out} is a file")


def _recordings(
    sources: Sequence[str], protocol: FieldProtocol, minutes: float, reader: Reader | None, stderr: Console
) -> tuple[list[Recording], list[Attacked]]:
    """Return the recordings without ground truth and those with it."""
    made, labelled = list[Recording](), list[Attacked]()
    for source in sources:
        with stderr.status(source):
            if source.partition(":")[0] == sumo.PREFIX and not Path(source).exists():
                made += sumo.recordings(source, minutes, protocol.seed)
            else:
                for recording, malicious in _at(Path(source), protocol, reader):
                    if malicious is None:
                        made.append(recording)
                    else:
                        labelled.append(of_ground_truth(recording, malicious))
    return made, labelled


def _at(path: Path, protocol: FieldProtocol, reader: Reader | None) -> Iterator[tuple[Recording, Bools | None]]:
    """Yield the recordings at or below a path, those of other systems last, and which messages are attacks."""
    files = sorted(path.rglob("*")) if path.is_dir() else [path]
    others = [file for file in files if reader is not None and file.is_file() and reader.recognises(file)]
    if not others or path.is_dir():
        yield from ((one, None) for one in load(path, protocol.runs, protocol.seed, without=others))
    if others:
        assert reader is not None
        yield from load_recorded(others, reader)


def _run(
    recordings: Sequence[Recording],
    labelled: Sequence[Attacked],
    protocol: FieldProtocol,
    processes: int,
    stderr: Console,
) -> dict[str, Any]:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task("recordings", total=None)
        measured = run_field(
            recordings, labelled, protocol, processes, lambda done, of: bar.update(task, completed=done, total=of)
        )
    return {
        "budget_per_hour": protocol.budget_per_hour,
        "runs": protocol.runs,
        "seed": protocol.seed,
        **measured,
    }
