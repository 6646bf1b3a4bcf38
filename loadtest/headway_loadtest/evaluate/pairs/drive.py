"""Real pairs, clean or with injected faults, through the service's own kernels.

A filter gets what a service gets: noisy readings of the follower, and the leader's own noisy sample of the same time.
It gets neither the truth nor a label.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from math import ceil
from pathlib import Path

import numpy as np

from headway.core.estimation.registry import Model
from headway.core.runtime import rows as banks
from headway.core.types.records import Records
from headway_loadtest.inject.faults import ALGORITHM_1, BY_LABEL, Corrupted, Kind, Spec, inject
from headway_loadtest.sources.drive import F64, SourceError
from headway_loadtest.sources.pairs import read_pair

READING_NOISE = 0.01
"""Standard deviation added to every reading, m and m/s, as in the published experiment."""
ALL, NONE = "all", "none"
"""Words for the published mixture of kinds, and for a clean drive."""
STARTS_PER_SAMPLE = 0.005
LEAST_S = 600.0
"""A run repeats a shorter pair with other noise and faults each time, because a minute holds only six events."""


@dataclass(frozen=True, slots=True)
class Pair:
    """A measured leader and follower; arrays are (n,), SI units. `group` is the name of the folder of its file."""

    group: str
    t_s: F64
    leader_x_m: F64
    leader_v_mps: F64
    leader_length_m: float
    x_m: F64
    v_mps: F64

    @property
    def hours(self) -> float:
        """How long it was driven."""
        return float(self.t_s[-1] - self.t_s[0]) / 3600.0


@dataclass(frozen=True, slots=True)
class InjectedDrive:
    """Readings of the follower in one drive: noise alone (`severity` 0), or noise and the faults of `corrupted`."""

    severity: float
    kind: str
    corrupted: Corrupted


def pair_files(paths: Iterable[Path]) -> list[Path]:
    """Return the CSV files among and below `paths`; SourceError where there is none."""
    files: list[Path] = []
    for path in paths:
        found = sorted(path.rglob("*.csv")) if path.is_dir() else [path]
        if not found or not found[0].is_file():
            raise SourceError(f"{path}: no pair file (CSV) there")
        files += found
    return files


def load(path: Path) -> Pair:
    """Read a pair file; SourceError names file, row and problem."""
    leader, follower = read_pair(path)
    return Pair(
        path.resolve().parent.name,
        follower.t_s,
        leader.x_m,
        leader.speed_mps,
        leader.length_m or 0.0,
        follower.x_m,
        follower.speed_mps,
    )


def injected_drives(
    pair: Pair, which: int, severities: Sequence[float], kinds: Sequence[str], runs: int, seed: int
) -> list[InjectedDrive]:
    """Return clean drives, and as many for each kind and severity; `which` is the pair's place in the list.

    There is one for each of `runs`, or more of a pair shorter than LEAST_S. A kind is a word of `inject.Kind` that
    concerns one sensor, or `all`.
    """
    made = []
    for run in range(runs * ceil(LEAST_S / (3600.0 * pair.hours))):
        rng = np.random.default_rng([seed, which, run])
        for severity, kind in [(0.0, NONE), *((severity, kind) for severity in severities for kind in kinds)]:
            spec = Spec(c=severity or 1.0, p=STARTS_PER_SAMPLE if severity else 0.0, kinds=_kinds(kind))
            made.append(InjectedDrive(severity, kind, inject(rng, *_noisy(rng, pair), spec)))
    return made


def _kinds(kind: str) -> tuple[Kind, ...]:
    return ALGORITHM_1 if kind in (ALL, NONE) else (BY_LABEL[kind],)


def _noisy(rng: np.random.Generator, pair: Pair) -> tuple[F64, F64]:
    n = len(pair.t_s)
    return pair.x_m + rng.normal(0.0, READING_NOISE, n), pair.v_mps + rng.normal(0.0, READING_NOISE, n)


def run_model(model: Model, pair: Pair, drives: Sequence[InjectedDrive], seed: int) -> Records:
    """Return the VERDICT of every reading, (n, drives): each drive has its own row of the bank."""
    n, m = len(pair.t_s), len(drives)
    rng = np.random.default_rng(seed)
    readings = banks.readings(n * m).reshape(n, m)
    readings["t_s"] = readings["leader_t_s"] = pair.t_s[:, None]
    readings["x_m"] = np.stack([injected.corrupted.x_m for injected in drives], axis=1)
    readings["v_mps"] = np.stack([injected.corrupted.v_mps for injected in drives], axis=1)
    readings["leader_x_m"] = pair.leader_x_m[:, None] + rng.normal(0.0, READING_NOISE, (n, m))
    readings["leader_v_mps"] = pair.leader_v_mps[:, None] + rng.normal(0.0, READING_NOISE, (n, m))
    readings["leader_length_m"] = pair.leader_length_m
    results = banks.verdicts(n * m).reshape(n, m)
    bank, rows = np.zeros(m, model.dtype), np.arange(m)
    for k in range(n):
        model.step_batch(bank, rows, readings[k], model.params, results[k])
    return results
