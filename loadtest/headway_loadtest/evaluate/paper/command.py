"""`headway evaluate paper` without its command line: options in, tables out, an exit code back."""

import json
from dataclasses import replace
from importlib.util import find_spec
from math import isfinite
from os import cpu_count
from pathlib import Path

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from headway_loadtest.evaluate.options import OptionError
from headway_loadtest.evaluate.paper.experiment import PaperResult, Protocol, run_paper
from headway_loadtest.evaluate.paper.leader import Leader, LeaderFileError, read_leader
from headway_loadtest.evaluate.paper.loop import Recovery
from headway_loadtest.evaluate.paper.report import markdown, print_report

BAD_INPUT = 2
JITTER_MAX_S = 1.0


def evaluate_paper(
    leader_csv: Path,
    protocol: Protocol,
    *,
    as_json: bool = False,
    out: Path | None = None,
    processes: int | None = None,
) -> int:
    """Run the experiment and print it; return the exit code: 0, or 2 for input that cannot be used.

    A reader gets the other recovery beside the one asked for; a script (`as_json`) gets what it asked for.
    """
    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        check(protocol, out)
        leader = read_leader(leader_csv)
    except (LeaderFileError, OptionError) as error:
        stderr.print(f"headway evaluate paper: {error}", markup=False)
        return BAD_INPUT
    others = [] if as_json else [recovery for recovery in Recovery if recovery is not protocol.recovery]
    results = [
        _run(leader, replace(protocol, recovery=recovery), processes or cpu_count() or 1, stderr)
        for recovery in (protocol.recovery, *others)
    ]
    if as_json:
        print(json.dumps(results[0].to_json(), allow_nan=False))  # noqa: T201 - standard output is the JSON
    else:
        print_report(results, Console())
    if out is not None:
        stderr.print(f"report: {write_report(results, leader, out)}", markup=False)
    return 0


def check(protocol: Protocol, out: Path | None) -> None:
    """Raise OptionError for options that the experiment cannot be run with."""
    if protocol.runs < 1:
        raise OptionError(f"--runs must be 1 or more, not {protocol.runs}")
    if not (isfinite(protocol.delay_jitter_s) and 0.0 <= protocol.delay_jitter_s <= JITTER_MAX_S):
        raise OptionError(f"--delay-jitter is in s, 0 to {JITTER_MAX_S:g}, not {protocol.delay_jitter_s:g}")
    if out is not None and find_spec("matplotlib") is None:
        raise OptionError("--out draws figures, which needs matplotlib; install headway[plots]")
    if out is not None and out.exists() and not out.is_dir():
        raise OptionError(f"--out must be a folder, and {out} is a file")


def write_report(results: list[PaperResult], leader: Leader, out: Path) -> Path:
    """Write `report.md` and its figures into the folder `out`, which is made if need be; return the report's path."""
    from headway_loadtest.evaluate.paper import figures  # noqa: PLC0415 - matplotlib is an extra

    protocol = results[0].protocol
    captions = {}
    out.mkdir(parents=True, exist_ok=True)
    for result in results:
        name = f"roc-{result.protocol.recovery}.png"
        captions[name] = f"Mean ROC curves with their AUC, recovery {result.protocol.recovery}"
        figures.save(figures.roc_figure(result), out / name)
    captions["innovations.png"] = f"Normalised innovations, tau = {figures.DELAY_S:g} s; circle: nis = {figures.GATE:g}"
    figures.save(figures.innovation_figure(leader, protocol), out / "innovations.png")
    captions["run.png"] = "One run of Model 2: speeds, location error, statistic"
    figures.save(figures.run_figure(leader, protocol), out / "run.png")
    report = out / "report.md"
    report.write_text(markdown(results, captions), encoding="utf-8")
    return report


def _run(leader: Leader, protocol: Protocol, processes: int, stderr: Console) -> PaperResult:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task(f"recovery {protocol.recovery}", total=None)
        return run_paper(leader, protocol, processes, lambda done, total: bar.update(task, completed=done, total=total))
