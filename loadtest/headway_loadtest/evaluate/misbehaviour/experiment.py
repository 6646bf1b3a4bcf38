"""Consistent misbehaviour, measured: recall, false alarms on clean drives, and whether the right car is the suspect.

Each event runs on a branch: the state of the pair tests is copied at a moment of the clean drive, the event runs on the
copy, and the clean drive goes on. So events do not affect each other, and the tests have learnt from clean readings.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from scipy.special import expit

from headway.core.consistency.pair_tests import (
    PAIR_TEST_VERDICT,
    PAIR_TESTS,
    PairTestParams,
    pair_test_params,
    step_pair_tests,
)
from headway.core.types.records import READING
from headway_loadtest.evaluate.misbehaviour.platoons import Platoon, chain, read_pair, synthetic
from headway_loadtest.inject.consistent import CONSISTENT, SAMPLE_S, displacement, samples, speed_offset
from headway_loadtest.inject.faults import F64, Kind

READING_NOISE = 0.01
"""Standard deviation of a reading, m and m/s, as in the published experiment."""
RANGE_NOISE_M, RANGE_RATE_NOISE_MPS = 0.2, 0.15
RANGE_OFFSET_M = 1.5
"""Reference points of location and sensor differ by up to this, unknown to the test."""
AFTER_S = 1.0
"""An alarm up to this long after an event belongs to it."""
EVERY_S = 6.0
"""Distance of the branches."""
FALSE_WINDOWS = 0.02
"""Share of clean windows above the gate of `recall_at_2pct_windows`."""
OFFSET_MIN_MPS = {Kind.FEIGNED_BRAKE: 2.9, Kind.DRAG: 0.6, Kind.REPLAY: 1.0, Kind.FREEZE: 1.0}
"""An event that never moves the speed so far, as a frozen speed at steady driving, is nearly true and not counted."""
ONE_ALARM_S = 5.0
"""Alarms closer than this are one."""
SYNTHETIC_PLATOONS, SYNTHETIC_S = 4, 300.0


@dataclass(slots=True)
class Findings:
    """Results of one group for one kind: an entry per clean window, per event, or per event found."""

    clean: list[float] = field(default_factory=list)
    misbehaving: list[float] = field(default_factory=list)
    alarmed: list[bool] = field(default_factory=list)
    named: list[bool] = field(default_factory=list)
    """Whether the attribution of the highest odds is the misbehaving sender."""
    named_at_onset: list[bool] = field(default_factory=list)
    """The same for the first attribution."""
    confidence: list[float] = field(default_factory=list)
    """Of the attribution of the highest odds."""
    confidence_at_onset: list[float] = field(default_factory=list)
    delay_s: list[float] = field(default_factory=list)


@njit(cache=True, error_model="numpy")
def drive(pair_tests: Any, readings: Any, leaders: Any, p: PairTestParams, verdicts: Any) -> None:
    """Take readings (n, m) through the pair tests, moment by moment, the first car of the platoon first."""
    rows = np.arange(leaders.size)
    for k in range(readings.shape[0]):
        step_pair_tests(pair_tests, rows, leaders, readings[k], p, verdicts[k])


def readings_of(rng: np.random.Generator, truth: Platoon, with_range: bool) -> Any:
    """Return READING (n, m) of correct senders: noisy positions and speeds, and forward sensors if asked for."""
    n, cars = truth.x_m.shape
    made = np.full((n, cars), np.nan, [(name, "f8") for name in READING.names or ()]).astype(READING)
    made["t_s"] = truth.t_s[:, None]
    made["x_m"] = truth.x_m + rng.normal(0.0, READING_NOISE, (n, cars))
    made["v_mps"] = truth.v_mps + rng.normal(0.0, READING_NOISE, (n, cars))
    made["leader_t_s"][:, 1:] = truth.t_s[:, None]
    made["leader_length_m"][:, 1:] = truth.length_m[:-1]
    if with_range:
        gap_m = truth.x_m[:, :-1] - truth.length_m[:-1] - truth.x_m[:, 1:]
        offset_m = rng.uniform(-RANGE_OFFSET_M, RANGE_OFFSET_M, cars - 1)
        made["range_m"][:, 1:] = gap_m + offset_m + rng.normal(0.0, RANGE_NOISE_M, gap_m.shape)
        rate_mps = truth.v_mps[:, :-1] - truth.v_mps[:, 1:]
        made["range_rate_mps"][:, 1:] = rate_mps + rng.normal(0.0, RANGE_RATE_NOISE_MPS, gap_m.shape)
    return fill_leaders(made)


def fill_leaders(readings: Any) -> Any:
    """Copy each car's own position and speed to the car behind it as its leader's, in place."""
    readings["leader_x_m"][:, 1:] = readings["x_m"][:, :-1]
    readings["leader_v_mps"][:, 1:] = readings["v_mps"][:, :-1]
    return readings


def score(verdicts: Any) -> F64:
    """(n,) largest statistic of any test of any pair, in standard deviations; 0 while warming."""
    tests = [verdicts[name]["statistic"] * ~verdicts[name]["warming"] for name in ("response", "ranging")]
    height: F64 = np.maximum(*tests).max(axis=1)
    return height


def onsets(alarmed: Any) -> int:
    """Count the alarms among (n,) flags at 10 Hz: those less than `ONE_ALARM_S` apart are one."""
    at = np.flatnonzero(alarmed)
    return int(at.size > 0) + int((np.diff(at) > ONE_ALARM_S / SAMPLE_S).sum())


def falsify(
    rng: np.random.Generator, truth: Platoon, true_readings: Any, start: int, sender: int, kind: Kind
) -> Any | None:
    """Return the readings from `start` on while the event and its alarms last; None if it is nearly true."""
    length = samples(kind)
    offset_mps = np.zeros(length + round(AFTER_S / SAMPLE_S))
    offset_mps[:length] = speed_offset(rng, kind, truth.v_mps[:, sender], start)
    if np.abs(offset_mps).max() < OFFSET_MIN_MPS[kind]:
        return None
    falsified = true_readings[start : start + offset_mps.size].copy()
    falsified["v_mps"][:, sender] += offset_mps
    falsified["x_m"][:, sender] += displacement(offset_mps)
    return fill_leaders(falsified)


def run_platoon(
    rng: np.random.Generator,
    truth: Platoon,
    senders: Sequence[int],
    with_range: bool,
    p: PairTestParams,
    findings: dict[Kind, Findings],
) -> tuple[int, float]:
    """Drive once clean with events on branches; add to `findings`, and return false alarms and clean pair-hours."""
    n, cars = truth.x_m.shape
    true_readings = readings_of(rng, truth, with_range)
    leaders = np.arange(-1, cars - 1)
    pair_tests, verdicts = np.zeros(cars, PAIR_TESTS), np.zeros((n, cars), PAIR_TEST_VERDICT)
    every = round(EVERY_S / SAMPLE_S)
    longest = max(samples(kind) for kind in CONSISTENT) + round(AFTER_S / SAMPLE_S)
    for start in range(0, n, every):
        ready = start > 0 and not verdicts["response"]["warming"][start - 1, 1:].any()
        for kind in findings if ready and start + longest < n else ():
            for sender in senders:
                falsified = falsify(rng, truth, true_readings, start, sender, kind)
                if falsified is not None:
                    results = np.zeros(falsified.shape, PAIR_TEST_VERDICT)
                    drive(pair_tests.copy(), falsified, leaders, p, results)
                    add_detection(findings[kind], results, sender)
        drive(pair_tests, true_readings[start : start + every], leaders, p, verdicts[start : start + every])
    warm_from = int(np.argmax(~verdicts["response"]["warming"][:, 1:].any(axis=1)))
    clean = verdicts[warm_from:] if warm_from else verdicts[n:]
    height = score(clean)
    for kind, found in findings.items():
        window = samples(kind) + round(AFTER_S / SAMPLE_S)
        found.clean += [float(height[k : k + window].max()) for k in range(0, len(height) - window, 10)]
    false_alarms = sum(onsets(clean["kind"][:, car] != Kind.NONE) for car in range(1, cars))
    return false_alarms, len(clean) * (cars - 1) * SAMPLE_S / 3600.0


def add_detection(found: Findings, results: Any, sender: int) -> None:
    """Add the results (n, m) of one event."""
    found.misbehaving.append(float(score(results).max()))
    at, followers = np.nonzero(results["kind"] != Kind.NONE)
    found.alarmed.append(at.size > 0)
    if at.size:
        log_odds = results["follower_log_odds"][at, followers]
        right = np.where(log_odds > 0.0, followers, followers - 1) == sender
        confidence = expit(np.abs(log_odds))
        surest = np.abs(log_odds).argmax()
        found.named.append(bool(right[surest]))
        found.named_at_onset.append(bool(right[0]))
        found.confidence.append(float(confidence[surest]))
        found.confidence_at_onset.append(float(confidence[0]))
        found.delay_s.append(float(at[0]) * SAMPLE_S)


def run_misbehaviour(paths: Iterable[Path], runs: int, seed: int, budget_per_hour: float = 1.0) -> list[dict[str, Any]]:
    """Measure every consistent kind on pairs (the follower misbehaves) and on platoons of four (any car does).

    Returns rows with `set`, `injection`, `with_range`, `cars`, `lies` (events), `recall_at_2pct_windows`,
    `recall_at_budget`, `false_alarms_per_hour` (per pair, on the clean drives), `detection_delay_s` (median). Of the
    events found at the budget: `suspect_correct` and `suspect_correct_at_onset`, by the strongest and by the first
    attribution, and their mean `confidence` and `confidence_at_onset`. Unknown values are None.
    """
    pairs = [read_pair(path) for path in paths]
    rng = np.random.default_rng(seed)
    made = [synthetic(rng, SYNTHETIC_S) for _ in range(SYNTHETIC_PLATOONS)]
    groups: dict[str, list[Platoon]] = defaultdict(list)
    for truth in [*pairs, *chain(pairs), *made]:
        groups[truth.group].append(truth)
    p = pair_test_params(budget_per_hour)
    return [
        row
        for group, truths in groups.items()
        for with_range in (False, True)
        for row in measure(group, truths, with_range, runs, seed, p)
    ]


def measure(
    group: str, truths: Sequence[Platoon], with_range: bool, runs: int, seed: int, p: PairTestParams
) -> Iterator[dict[str, Any]]:
    """Yield a row per kind for drives of one group."""
    findings = {kind: Findings() for kind in CONSISTENT}
    false_alarms, hours = 0, 0.0
    cars = truths[0].x_m.shape[1]
    senders = range(cars) if cars > 2 else (1,)
    for run in range(runs):
        for truth in truths:
            more, longer = run_platoon(np.random.default_rng([seed, run]), truth, senders, with_range, p, findings)
            false_alarms, hours = false_alarms + more, hours + longer
    for kind, found in findings.items():
        gate = float(np.quantile(found.clean, 1.0 - FALSE_WINDOWS)) if found.clean else np.inf
        yield {
            "set": group,
            "injection": kind.label,
            "with_range": with_range,
            "cars": cars,
            "lies": len(found.misbehaving),
            "recall_at_2pct_windows": mean([height > gate for height in found.misbehaving]),
            "recall_at_budget": mean(found.alarmed),
            "false_alarms_per_hour": false_alarms / hours if hours else None,
            "suspect_correct": mean(found.named),
            "suspect_correct_at_onset": mean(found.named_at_onset),
            "confidence": mean(found.confidence),
            "confidence_at_onset": mean(found.confidence_at_onset),
            "detection_delay_s": float(np.median(found.delay_s)) if found.delay_s else None,
        }


def mean(values: Sequence[float]) -> float | None:
    """Return the mean, or None of nothing; for truth values it is the share that is true."""
    return sum(values) / len(values) if values else None
