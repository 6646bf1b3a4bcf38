"""Every model on real pairs: recall, false alarms, and the error of the recovered readings.

`headway` learns its gate from the alarm budget and its own readings. The other models get the lowest gate that keeps
the budget on the clean drives of their set, which a service could not know.
The ceiling is the ROC of |z - truth|^2 on the same drives: a memoryless detector that knows the true state.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import product
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from headway.core.estimation import registry
from headway.core.estimation.registry import Model
from headway.core.types.config import DetectorConfig
from headway_loadtest.evaluate.pairs.drive import Pair, injected_drives, load, pair_files, run_model
from headway_loadtest.evaluate.pairs.score import Score, gate_for, score, summary, total
from headway_loadtest.sources.drive import F64

Progress = Callable[[int, int], None]
"""Called with the finished and the total number of parts."""
CLEAN = 0.0
EVERY_SET = "all"


def _silent(_done: int, _of: int) -> None:
    """Report no progress."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PairsProtocol:
    """What is run. `kinds` are words of `inject.Kind` that concern one sensor, or `all` for the published mixture."""

    models: tuple[str, ...] = ("ca", "ekf", "aekf", "headway")
    delays_s: tuple[float, ...] = (0.0, 0.5, 1.5)
    severities: tuple[float, ...] = (1.0, 0.5, 0.1)
    kinds: tuple[str, ...] = ("all",)
    runs: int = 3
    seed: int = 0
    budget_per_hour: float = 1.0


@dataclass(frozen=True, slots=True)
class PairRun:
    """One pair before one model: what one process does at a time. `gate` None: the model's own."""

    pair: Pair
    which: int
    model: str
    delay_s: float
    gate: float | None
    protocol: PairsProtocol


Cell = tuple[str, str, float]
"""(set, model, delay in s)"""
Condition = tuple[float, str]
"""(severity, kind)"""


def run_pairs(
    paths: Iterable[Path], protocol: PairsProtocol, processes: int = 1, progress: Progress = _silent
) -> dict[str, Any]:
    """Run the protocol on pair files, or folders of them, and return what `--json` prints.

    `rows` has an entry for each set, model, delay, severity and kind; `clean` the false alarms on clean drives, by set
    and over all sets. Values are None where there was nothing to measure.

    Raises
    ------
    SourceError
        A file cannot be read.
    """
    pairs = [load(path) for path in pair_files(paths)]
    cells = product(enumerate(pairs), protocol.models, protocol.delays_s)
    parts = [PairRun(pair, which, model, delay_s, None, protocol) for (which, pair), model, delay_s in cells]
    gateless = [part for part in parts if _takes_gate(part)]
    scores: dict[Cell, dict[Condition, list[Score]]] = {}
    for part in {(part.model, part.delay_s): part for part in parts}.values():
        _model(part).warm_up()
    with _workers(processes) as spread:
        done, of = 0, len(gateless) + len(parts)
        clean_drives: dict[Cell, list[tuple[F64, float]]] = {}
        for part, collected in zip(gateless, spread(clean_statistics, gateless), strict=True):
            clean_drives.setdefault(_cell(part), []).extend(collected)
            progress(done := done + 1, of)
        gates = {cell: _gate(collected, protocol.budget_per_hour) for cell, collected in clean_drives.items()}
        gated = [replace(part, gate=gates.get(_cell(part))) for part in parts]
        for part, made in zip(gated, spread(measure, gated), strict=True):
            for condition, one in made:
                scores.setdefault(_cell(part), {}).setdefault(condition, []).append(one)
            progress(done := done + 1, of)
    return {
        "budget_per_hour": protocol.budget_per_hour,
        "runs": protocol.runs,
        "seed": protocol.seed,
        "rows": list(_rows(scores, gates)),
        "clean": list(_clean(scores)),
    }


@contextmanager
def _workers(processes: int) -> Iterator[Callable[..., Iterable[Any]]]:
    """Give a `map` that works in this process, or in several."""
    if processes == 1:
        yield map
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield pool.map


def _gate(collected: Sequence[tuple[F64, float]], budget_per_hour: float) -> float:
    return gate_for([statistic for statistic, _ in collected], sum(hours for _, hours in collected), budget_per_hour)


def _cell(part: PairRun) -> Cell:
    return part.pair.group, part.model, part.delay_s


def _model(part: PairRun) -> Model:
    config = DetectorConfig(model=part.model, delay_s=part.delay_s, alarm_budget_per_hour=part.protocol.budget_per_hour)
    model = registry.build(config)
    return model if part.gate is None else replace(model, params=model.params._replace(gate=part.gate))


def _takes_gate(part: PairRun) -> bool:
    return "gate" in _model(part).params._fields


def clean_statistics(part: PairRun) -> list[tuple[F64, float]]:
    """Return statistic and hours of each clean drive, without any rejection."""
    p = part.protocol
    drives = injected_drives(part.pair, part.which, (), (), p.runs, p.seed)
    results = run_model(_model(replace(part, gate=np.inf)), part.pair, drives, p.seed)
    warm = ~results["warming"][:, 0]
    return [(results["statistic"][warm, k].copy(), part.pair.hours) for k in range(len(drives))]


def measure(part: PairRun) -> list[tuple[Condition, Score]]:
    """Score every drive of one pair with one model."""
    p = part.protocol
    drives = injected_drives(part.pair, part.which, p.severities, p.kinds, p.runs, p.seed)
    results = run_model(_model(part), part.pair, drives, p.seed)
    return [((one.severity, one.kind), score(part.pair, one, results[:, k])) for k, one in enumerate(drives)]


def _rows(scores: dict[Cell, dict[Condition, list[Score]]], gates: dict[Cell, float]) -> Iterator[dict[str, Any]]:
    for (group, model, delay_s), conditions in scores.items():
        clean = total(_clean_scores(conditions))
        for (severity, kind), many in conditions.items():
            if severity != CLEAN:
                yield {
                    "set": group,
                    "model": model,
                    "delay_s": delay_s,
                    "severity": severity,
                    "kind": kind,
                    "false_alarms_per_hour": clean.false_alarms / clean.hours,
                    "gate": gates.get((group, model, delay_s)),
                    **summary(many),
                }


def _clean(scores: dict[Cell, dict[Condition, list[Score]]]) -> Iterator[dict[str, Any]]:
    collected: dict[Cell, list[Score]] = {}
    for (group, model, delay_s), conditions in scores.items():
        for cell in ((group, model, delay_s), (EVERY_SET, model, delay_s)):
            collected.setdefault(cell, []).extend(_clean_scores(conditions))
    for (group, model, delay_s), clean_drives in collected.items():
        clean = total(clean_drives)
        yield {
            "set": group,
            "model": model,
            "delay_s": delay_s,
            "false_alarms": clean.false_alarms,
            "hours": clean.hours,
            "false_alarms_per_hour": clean.false_alarms / clean.hours,
        }


def _clean_scores(conditions: dict[Condition, list[Score]]) -> list[Score]:
    return [one for (severity, _), many in conditions.items() if severity == CLEAN for one in many]
