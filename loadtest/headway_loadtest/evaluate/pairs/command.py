"""`headway evaluate pairs` without its command line: options in, tables out, an exit code back."""

import json
from collections.abc import Sequence
from importlib.util import find_spec
from math import isfinite
from os import cpu_count
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from headway.core.estimation.registry import MODELS
from headway_loadtest.evaluate.misbehaviour.experiment import run_misbehaviour
from headway_loadtest.evaluate.options import OptionError
from headway_loadtest.evaluate.pairs.drive import ALL, load, pair_files
from headway_loadtest.evaluate.pairs.experiment import PairsProtocol, run_pairs
from headway_loadtest.evaluate.pairs.report import markdown, print_report
from headway_loadtest.inject.faults import ALGORITHM_1, Kind
from headway_loadtest.sources.drive import SourceError

BAD_INPUT = 2
DELAY_MAX_S = 5.0
KINDS = (ALL, *(kind.label for kind in (*ALGORITHM_1, Kind.SHORT)))


def evaluate_pairs(
    paths: Sequence[Path],
    protocol: PairsProtocol,
    *,
    as_json: bool = False,
    out: Path | None = None,
    processes: int | None = None,
) -> int:
    """Run the protocol and print it; return the exit code: 0, or 2 for input that cannot be used."""
    stderr = Console(stderr=True, soft_wrap=True, highlight=False)
    try:
        check(protocol, out)
        result = _run(paths, protocol, processes or cpu_count() or 1, stderr)
        with stderr.status("consistent misbehaviour"):
            result["liars"] = run_misbehaviour(
                pair_files(paths), protocol.runs, protocol.seed, protocol.budget_per_hour
            )
    except (SourceError, OptionError) as error:
        stderr.print(f"headway evaluate pairs: {error}", markup=False)
        return BAD_INPUT
    if as_json:
        print(json.dumps(result, allow_nan=False))  # noqa: T201 - standard output is the JSON
    else:
        print_report(result, Console())
    if out is not None:
        stderr.print(f"report: {write_report(result, paths, protocol, out)}", markup=False)
    return 0


def check(protocol: PairsProtocol, out: Path | None) -> None:
    """Raise OptionError for options that the evaluation cannot be run with."""
    for option, words, known in (("--models", protocol.models, tuple(MODELS)), ("--kinds", protocol.kinds, KINDS)):
        unknown = [word for word in words if word not in known]
        if unknown or not words:
            raise OptionError(f"{option} takes words of {', '.join(known)}, not '{','.join(words)}'")
    if not protocol.severities or not all(isfinite(c) and c > 0.0 for c in protocol.severities):
        raise OptionError("--severity takes variances above 0, such as 1,0.5,0.1")
    if not protocol.delays_s or not all(0.0 <= tau <= DELAY_MAX_S for tau in protocol.delays_s):
        raise OptionError(f"--delay takes times in s, 0 to {DELAY_MAX_S:g}, such as 0,0.5,1.5")
    if protocol.runs < 1:
        raise OptionError(f"--runs must be 1 or more, not {protocol.runs}")
    if not protocol.budget_per_hour > 0.0:
        raise OptionError(f"the alarm budget is false alarms per hour, above 0, not {protocol.budget_per_hour:g}")
    if out is not None and find_spec("matplotlib") is None:
        raise OptionError("--out draws figures, which needs matplotlib; install headway[plots]")
    if out is not None and out.exists() and not out.is_dir():
        raise OptionError(f"--out must be a folder, and {out} is a file")


def write_report(result: dict[str, Any], paths: Sequence[Path], protocol: PairsProtocol, out: Path) -> Path:
    """Write `report.md`, `result.json` and the figures into the folder `out`; return the report's path."""
    from headway_loadtest.evaluate.pairs import figures  # noqa: PLC0415 - matplotlib is an extra

    out.mkdir(parents=True, exist_ok=True)
    drawn = {
        "recall.png": (
            figures.bars(result, "recall_at_budget", "event recall"),
            f"Event recall at {protocol.budget_per_hour:g} false alarms per pair-hour; black: over delays and kinds",
        ),
        "share.png": (figures.bars(result, "share_of_ceiling", "share of ceiling"), "Share of the memoryless ceiling"),
        "drive.png": (
            figures.drive(load(pair_files(paths)[0]), protocol.seed),
            "Part of the first drive, c = 1: readings and recovered values of `headway` less the truth; shaded: faults",
        ),
    }
    for name, (figure, _) in drawn.items():
        figure.savefig(out / name, dpi=70, bbox_inches="tight")
    (out / "result.json").write_text(json.dumps(result, allow_nan=False, indent=1), encoding="utf-8")
    report = out / "report.md"
    report.write_text(markdown(result, {name: caption for name, (_, caption) in drawn.items()}), encoding="utf-8")
    return report


def _run(paths: Sequence[Path], protocol: PairsProtocol, processes: int, stderr: Console) -> dict[str, Any]:
    columns = (SpinnerColumn(), TextColumn("{task.description}"), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns, console=stderr, transient=True) as bar:
        task = bar.add_task("pairs", total=None)
        return run_pairs(paths, protocol, processes, lambda done, of: bar.update(task, completed=done, total=of))
