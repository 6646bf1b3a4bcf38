"""Scores of a detector's verdicts on a drive with labels.

An injected event is **found** when an alarm of its vehicle stands at some time between its first sample and a second
after its last. A **false alarm** is an episode of alarms (gaps up to a second belong to it) no part of which falls into
such a window; on clean drives every episode is one. Readings of the warm-up are left out everywhere.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from headway.core.types import records
from headway.core.types.records import Records
from headway_loadtest.evaluate.pairs.drive import InjectedDrive, Pair
from headway_loadtest.inject.faults import Injected, Kind, Sensor
from headway_loadtest.sources.drive import F64

Bools = NDArray[np.bool_]
GRACE_S = 1.0
SAMPLE_S = 0.1
GRACE = round(GRACE_S / SAMPLE_S)
SENSOR_CODE = {Sensor.LOCATION: records.Sensor.LOCATION, Sensor.SPEED: records.Sensor.SPEED}


@dataclass(slots=True)
class Score:
    """Sums over one drive, or over several."""

    auc: list[float]
    ceiling: list[float]
    found: Counter[str]
    events: Counter[str]
    delays_s: list[float]
    kinds: Counter[tuple[str, str]]
    """(injected, named) kinds of the events found with the right sensor."""
    named: int
    """Events found with the right sensor."""
    false_alarms: int
    hours: float
    """Outside all windows."""
    squares: F64
    """(2, 2): recovered and corrupted squared error, of location and speed, over the faulty samples."""
    samples: NDArray[np.int64]
    """(2,) faulty samples."""


def score(pair: Pair, injected: InjectedDrive, results: Records) -> Score:
    """Compare verdicts (n,) with what was injected."""
    warm = ~results["warming"]
    corrupted = injected.corrupted
    alarms = results["anomalous"] & warm
    faulty = np.stack([corrupted.x_kind > 0, corrupted.v_kind > 0]) & warm
    truth = np.stack([pair.x_m, pair.v_mps])
    reported = np.stack([corrupted.x_m, corrupted.v_mps])
    recovered = np.stack([results["x_m"], results["v_mps"]])
    made = Score([], [], Counter(), Counter(), [], Counter(), 0, 0, 0.0, np.zeros((2, 2)), faulty.sum(axis=1))
    for row, values in enumerate((recovered, reported)):
        made.squares[row] = (((values - truth) ** 2) * faulty).sum(axis=1)
    labels = corrupted.anomalous[warm]
    if labels.any() and not labels.all():
        made.auc.append(auc(results["statistic"][warm], labels))
        made.ceiling.append(auc(((reported - truth) ** 2).sum(axis=0)[warm], labels))
    first = int(np.argmax(warm))
    windows = np.zeros(len(alarms), np.bool_)
    for event in corrupted.events:
        window = slice(event.start, event.stop + GRACE)
        windows[window] = True
        if event.start >= first:
            _note(made, event, alarms, results, window)
    made.false_alarms = episodes(alarms, windows)
    made.hours = float((warm & ~windows).sum()) * SAMPLE_S / 3600.0
    return made


def _note(made: Score, event: Injected, alarms: Bools, results: Records, window: slice) -> None:
    """Add one event: whether and when it was found, and the sensor and kind that were named last."""
    made.events[event.kind.label] += 1
    at = np.flatnonzero(alarms[window])
    if not at.size:
        return
    made.found[event.kind.label] += 1
    made.delays_s.append(float(at[0]) * SAMPLE_S)
    during = results[event.start : event.stop]
    isolated = (during["sensor"] == SENSOR_CODE[event.sensor]) | (during["sensor"] == records.Sensor.BOTH)
    named = np.flatnonzero(alarms[event.start : event.stop] & isolated)
    if named.size:
        made.named += 1
        true = Kind.SHORT if event.stop - event.start == 1 else event.kind
        made.kinds[true.label, records.Kind(int(during["kind"][named[-1]])).label] += 1


def auc(statistic: F64, labels: Bools) -> float:
    """Return the probability that a labelled sample has the greater statistic (Mann-Whitney), ties counting half."""
    ranks = rankdata(statistic)
    positive = int(labels.sum())
    negative = labels.size - positive
    return float((ranks[labels].sum() - positive * (positive + 1) / 2.0) / (positive * negative))


def episodes(alarms: Bools, windows: Bools | None = None) -> int:
    """Count the episodes of alarms, those that touch a window left out."""
    at = np.flatnonzero(alarms)
    if not at.size:
        return 0
    begins = np.r_[True, np.diff(at) > GRACE]
    if windows is None:
        return int(begins.sum())
    touched = np.maximum.reduceat(windows[at], np.flatnonzero(begins))
    return int((~touched).sum())


def gate_for(statistics: Sequence[F64], hours: float, budget_per_hour: float) -> float:
    """Return the lowest gate at which clean drives (each (n,), `hours` together) keep within the budget."""
    allowed = budget_per_hour * hours
    candidates = np.unique(np.concatenate([np.sort(one)[-2000:] for one in statistics]))
    low, high = 0, candidates.size - 1
    while low < high:
        middle = (low + high) // 2
        if sum(episodes(one > candidates[middle]) for one in statistics) <= allowed:
            high = middle
        else:
            low = middle + 1
    return float(candidates[low])


def total(scores: Sequence[Score]) -> Score:
    """Add up."""
    return Score(
        [value for one in scores for value in one.auc],
        [value for one in scores for value in one.ceiling],
        sum((one.found for one in scores), Counter()),
        sum((one.events for one in scores), Counter()),
        [value for one in scores for value in one.delays_s],
        sum((one.kinds for one in scores), Counter()),
        sum(one.named for one in scores),
        sum(one.false_alarms for one in scores),
        sum(one.hours for one in scores),
        np.sum([one.squares for one in scores], axis=0),
        np.sum([one.samples for one in scores], axis=0),
    )


def summary(scores: Sequence[Score]) -> dict[str, Any]:
    """Return the numbers of a row of the result; None where there was nothing to measure."""
    every = total(scores)
    auc_mean, ceiling = _mean(every.auc), _mean(every.ceiling)
    found, events = every.found.total(), every.events.total()
    right = sum(count for (true, named), count in every.kinds.items() if true == named)
    rmse = np.sqrt(every.squares / np.maximum(every.samples, 1))
    seen = bool(every.samples.all())
    share = None
    if auc_mean is not None and ceiling is not None and ceiling != 0.5:
        share = (auc_mean - 0.5) / (ceiling - 0.5)
    return {
        "auc": auc_mean,
        "auc_std": float(np.std(every.auc, ddof=1)) if len(every.auc) > 1 else None,
        "ceiling": ceiling,
        "share_of_ceiling": share,
        "recall_at_budget": _ratio(found, events),
        "recall_by_kind": {kind: every.found[kind] / count for kind, count in sorted(every.events.items())},
        "events": events,
        "detection_delay_s": float(np.median(every.delays_s)) if every.delays_s else None,
        "false_alarms_per_hour_between_events": _ratio(every.false_alarms, every.hours),
        "sensor_correct": _ratio(every.named, found),
        "kind_correct": _ratio(right, every.named),
        "confusion": _nested(every.kinds),
        "recovered_rmse_m": float(rmse[0, 0]) if seen else None,
        "recovered_rmse_mps": float(rmse[0, 1]) if seen else None,
        "corrupted_rmse_m": float(rmse[1, 0]) if seen else None,
        "corrupted_rmse_mps": float(rmse[1, 1]) if seen else None,
        "recovered_share_location": float(rmse[0, 0] / rmse[1, 0]) if seen else None,
        "recovered_share_speed": float(rmse[0, 1] / rmse[1, 1]) if seen else None,
    }


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _ratio(part: float, whole: float) -> float | None:
    return part / whole if whole else None


def _nested(kinds: Counter[tuple[str, str]]) -> dict[str, dict[str, int]]:
    nested: dict[str, dict[str, int]] = {}
    for (true, named), count in sorted(kinds.items()):
        nested.setdefault(true, {})[named] = count
    return nested
