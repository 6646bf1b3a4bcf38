"""The published experiment with the service's own core: Tables 1 and 2 of Wang, Masoud, Khojandi 2020.

Source: arXiv:2004.09496. `DEVIATIONS` names every point where this protocol is not what the paper's text says. Each run
is one seed: one simulated follower, and one set of events for both models, so that their AUCs are paired.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass, field
from itertools import product
from math import sqrt
from multiprocessing import get_context
from typing import Any

import numpy as np
from scipy.stats import ttest_rel

from headway_loadtest.evaluate.paper import roc
from headway_loadtest.evaluate.paper.default_model import default_aucs
from headway_loadtest.evaluate.paper.follower import CorruptedReadings, Follower, corrupt, drive
from headway_loadtest.evaluate.paper.leader import SAMPLES_MIN, Leader
from headway_loadtest.evaluate.paper.loop import History, Recovery, params, run
from headway_loadtest.sources.drive import F64

MODELS = ("ekf", "aekf")
DELAYS_S = (0.0, 0.5, 1.5)
SEVERITIES = (1.0, 0.5, 0.1)
CURVE_FPR: F64 = np.linspace(0.0, 1.0, 101)

Cell = tuple[str, float, float]
"""(model, delay in s, severity)"""
CleanNumbers = tuple[float, float, float, float]
"""Mean innovation of location (m) and speed (m/s), MSE as printed, share of the readings that repaired P."""
Progress = Callable[[int, int], None]
"""Called with the finished and the total number of (seed, delay) parts."""

PRINTED_AUC: dict[Cell, float] = {
    (model, delay_s, severity): auc
    for model, rows in {
        "ekf": ((0.984, 0.931, 0.855), (0.972, 0.917, 0.799), (0.871, 0.718, 0.576)),
        "aekf": ((0.983, 0.945, 0.902), (0.969, 0.928, 0.844), (0.867, 0.759, 0.731)),
    }.items()
    for severity, row in zip(SEVERITIES, rows, strict=True)
    for delay_s, auc in zip(DELAYS_S, row, strict=True)
}
PRINTED_INNOVATION: dict[tuple[str, float], tuple[float, float, float]] = {
    ("ekf", 0.0): (-0.003, 0.022, 7.12e-4),
    ("ekf", 0.5): (-0.146, 0.028, 0.033),
    ("ekf", 1.5): (-0.436, 0.062, 0.098),
    ("aekf", 0.0): (-0.002, 0.024, 8.43e-4),
    ("aekf", 0.5): (-0.033, 0.036, 0.032),
    ("aekf", 1.5): (-0.097, 0.095, 0.095),
}
"""Mean innovation of location (m) and speed (m/s), and what Table 2 calls MSE."""

DEVIATIONS = {
    "simulated follower": "the follower is not measured: the filter's own IDM drives it, never backwards",
    "random acceleration": "with tau > 0 its location slips by a_r tau dt per step, a_r ~ N(-0.65, 0.25^2) m/s2",
    "delayed input": "the leader's input reaches the follower floor(tau / dt) samples late; the filter knows tau",
    "readings": "reading noise has standard deviation 0.01 while the filter's R says 0.1",
    "severity": "c is a variance: noise and bias are N(0, c); a drift climbs to U(0, 1) c",
    "kinds": "noise, bias and drift of 1 to 20 samples; short is a duration of one sample, miss is left out",
    "label": "a row counts as anomalous if either sensor has an event, visible or not",
    "oracle": "recovery ground-truth: a rejected reading is replaced by the truth, and the estimate put on it",
    "prediction": "recovery prediction is the service's: a filter that rejects 30 readings in a row begins anew",
    "history": "constant takes s(t - tau) = s(t), P likewise, as the published solver does; buffers is the equation",
    "third noise": "Q = diag(0.5, 0.3), for Model 2 with a third entry of 0.01; delta beyond 0.5 m is set to zero",
    "guard": "P is kept symmetric with eigenvalues above a floor; each repair is counted",
    "closed loop": "each ROC has 100 runs, one per quantile of the nis of a run that rejects nothing",
    "table 2": "nothing is injected or rejected; MSE is the root of the sum of both states' MSEs, as printed",
}
"""Where the protocol differs from the paper's text, or adds to it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Protocol:
    """What a caller decides about the experiment."""

    runs: int = 20
    recovery: Recovery = Recovery.GROUND_TRUTH
    history: History = History.CONSTANT
    delay_jitter_s: float = 0.0
    seed: int = 1

    @property
    def seeds(self) -> tuple[int, ...]:
        """One per run."""
        return tuple(range(self.seed, self.seed + self.runs))


@dataclass(frozen=True, slots=True)
class Table1Row:
    """One cell: AUC over the runs, and the paired t-test of Model 1 against Model 2 there (None below two runs)."""

    model: str
    delay_s: float
    severity: float
    auc: float
    auc_std: float | None
    p_value: float | None
    printed: float


@dataclass(frozen=True, slots=True)
class DefaultRow:
    """The service's default model in the cell of Table 1, always without an oracle, beside the printed Model 2."""

    delay_s: float
    severity: float
    auc: float
    auc_std: float | None
    printed: float


@dataclass(frozen=True, slots=True)
class Table2Row:
    """Clean drives: mean innovations, error of the estimate, and how often per reading P had to be repaired."""

    model: str
    delay_s: float
    innovation_m: float
    innovation_mps: float
    mse: float
    repaired_share: float
    printed: tuple[float, float, float]
    """The first three as printed."""


@dataclass(frozen=True, slots=True)
class PaperResult:
    """Both tables and the mean ROC curves (true-positive rate at `CURVE_FPR`)."""

    protocol: Protocol
    samples: int
    table1: tuple[Table1Row, ...]
    table2: tuple[Table2Row, ...]
    default: tuple[DefaultRow, ...]
    curves: dict[Cell, F64] = field(repr=False)

    @property
    def mean_absolute_deviation(self) -> float:
        """From the 18 printed cells of Table 1."""
        return float(np.mean([abs(row.auc - row.printed) for row in self.table1]))

    def to_json(self) -> dict[str, Any]:
        """Return what JSON can hold."""
        return {
            "samples": self.samples,
            **asdict(self.protocol),
            "seeds": list(self.protocol.seeds),
            "mean_absolute_deviation": self.mean_absolute_deviation,
            "table1": [asdict(row) for row in self.table1],
            "table2": [asdict(row) for row in self.table2],
            "headway": [asdict(row) for row in self.default],
            "deviations": DEVIATIONS,
        }


@dataclass(frozen=True, slots=True)
class SeedRun:
    """What one seed shows at one delay."""

    delay_s: float
    rocs: dict[Cell, roc.Roc]
    clean: dict[str, CleanNumbers]
    """By model."""
    default: dict[float, float]
    """AUC of the default model, by severity."""


def run_paper(leader: Leader, protocol: Protocol, processes: int = 1, progress: Progress | None = None) -> PaperResult:
    """Run the experiment behind a leader's drive; equal arguments give equal results, however many processes."""
    tasks = [(leader, protocol, delay_s, seed) for seed, delay_s in product(protocol.seeds, DELAYS_S)]
    parts = []
    for part in _map(tasks, processes):
        parts.append(part)
        if progress is not None:
            progress(len(parts), len(tasks))
    return _collect(protocol, len(leader.x_m), parts)


Task = tuple[Leader, Protocol, float, int]


def _map(tasks: Sequence[Task], processes: int) -> Iterator[SeedRun]:
    if processes == 1:
        yield from map(_part, tasks)
        return
    one_of_each_delay = {delay_s: (leader, protocol, delay_s, seed) for leader, protocol, delay_s, seed in tasks}
    for task in one_of_each_delay.values():
        _compile(task)
    with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
        try:
            yield from pool.map(_part, tasks)
        finally:
            pool.shutdown(cancel_futures=True)


def _compile(task: Task) -> None:
    """Fill the kernels' cache before the processes start (`Model.warm_up`)."""
    leader, protocol, delay_s, seed = task
    short = Leader(leader.x_m[:SAMPLES_MIN], leader.v_mps[:SAMPLES_MIN])
    follower = drive(short, delay_s, 0.0, seed)
    default_aucs({1.0: corrupt(follower, 1.0, seed)}, delay_s)
    for model in MODELS:
        run(model, params(model, delay_s), follower, follower.readings, protocol.recovery, protocol.history)


def _part(task: Task) -> SeedRun:
    leader, protocol, delay_s, seed = task
    follower = drive(leader, delay_s, protocol.delay_jitter_s, seed)
    by_severity = {severity: corrupt(follower, severity, seed) for severity in SEVERITIES}
    rocs = {
        (model, delay_s, severity): _roc(model, delay_s, protocol, follower, corrupted)
        for model in MODELS
        for severity, corrupted in by_severity.items()
    }
    clean = {model: _clean(model, delay_s, protocol, follower) for model in MODELS}
    return SeedRun(delay_s, rocs, clean, default_aucs(by_severity, delay_s))


def _roc(model: str, delay_s: float, protocol: Protocol, follower: Follower, corrupted: CorruptedReadings) -> roc.Roc:
    p = params(model, delay_s, protocol.delay_jitter_s)

    def at_gate(gate: float) -> Any:
        return run(model, p._replace(gate=gate), follower, corrupted.readings, protocol.recovery, protocol.history)

    gates = roc.thresholds(at_gate(np.inf)["nis"])
    return roc.closed_loop(lambda gate: at_gate(gate)["anomalous"], corrupted.anomalous, gates)


def _clean(model: str, delay_s: float, protocol: Protocol, follower: Follower) -> CleanNumbers:
    p = params(model, delay_s, protocol.delay_jitter_s)
    results = run(model, p, follower, follower.readings, protocol.recovery, protocol.history)
    mse = np.mean((results["x_m"] - follower.x_m) ** 2) + np.mean((results["v_mps"] - follower.v_mps) ** 2)
    innovation_m, innovation_mps = results["nu"].mean(axis=0)
    return float(innovation_m), float(innovation_mps), sqrt(mse), float(results["repaired"].mean())


def _collect(protocol: Protocol, samples: int, parts: Iterable[SeedRun]) -> PaperResult:
    rocs: dict[Cell, list[roc.Roc]] = {cell: [] for cell in product(MODELS, DELAYS_S, SEVERITIES)}
    clean: dict[tuple[str, float], list[CleanNumbers]] = {cell: [] for cell in product(MODELS, DELAYS_S)}
    default: dict[tuple[float, float], list[float]] = {cell: [] for cell in product(DELAYS_S, SEVERITIES)}
    for part in parts:
        for severity, found_auc in part.default.items():
            default[part.delay_s, severity].append(found_auc)
        for cell, found in part.rocs.items():
            rocs[cell].append(found)
        for model, numbers in part.clean.items():
            clean[model, part.delay_s].append(numbers)
    aucs = {cell: np.array([found.auc for found in many]) for cell, many in rocs.items()}
    return PaperResult(
        protocol,
        samples,
        tuple(_row(cell, aucs) for cell in aucs),
        tuple(_clean_row(model, delay_s, numbers) for (model, delay_s), numbers in clean.items()),
        tuple(
            DefaultRow(delay_s, severity, float(np.mean(many)), _std(many), PRINTED_AUC["aekf", delay_s, severity])
            for (delay_s, severity), many in default.items()
        ),
        {
            cell: np.mean([np.interp(CURVE_FPR, found.fpr, found.tpr) for found in many], axis=0)
            for cell, many in rocs.items()
        },
    )


def _row(cell: Cell, aucs: dict[Cell, F64]) -> Table1Row:
    model, delay_s, severity = cell
    mine = aucs[cell]
    std, p_value = _std(mine), None
    if len(mine) > 1:
        p_value = _paired_t_test(aucs["ekf", delay_s, severity], aucs["aekf", delay_s, severity])
    return Table1Row(model, delay_s, severity, float(mine.mean()), std, p_value, PRINTED_AUC[cell])


def _std(values: Sequence[float] | F64) -> float | None:
    return float(np.std(values, ddof=1)) if len(values) > 1 else None


def _clean_row(model: str, delay_s: float, numbers: Sequence[CleanNumbers]) -> Table2Row:
    innovation_m, innovation_mps, mse, repaired_share = np.mean(numbers, axis=0).tolist()
    printed = PRINTED_INNOVATION[model, delay_s]
    return Table2Row(model, delay_s, innovation_m, innovation_mps, mse, repaired_share, printed)


def _paired_t_test(first: F64, second: F64) -> float | None:
    """Two-sided p-value that both have one mean; None where they do not differ at all."""
    if np.ptp(first - second) == 0.0:
        return None
    return float(ttest_rel(first, second).pvalue)
