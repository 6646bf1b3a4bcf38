"""Latency of records by stage, in histograms that are cheap to fill."""

import math
from collections.abc import Mapping
from enum import StrEnum, unique
from typing import Final, NamedTuple

import numpy as np

from headway.core.types.batch import F64, I64

_PER_DECADE: Final = 24
EDGES_US: Final = 10.0 * 10.0 ** (np.arange(7 * _PER_DECADE + 1) / _PER_DECADE)
"""Upper edges of the buckets, 10 us to 100 s, each a tenth wider than the one before."""
_UPPER_US: Final = [*EDGES_US.tolist(), 2.0 * float(EDGES_US[-1])]
"""Value below which each bucket lies; those above the last edge count at twice it."""
_MIDDLES: Final = [*(EDGES_US * 10.0 ** (-0.5 / _PER_DECADE)).tolist(), math.inf]
"""Value that represents a bucket: within 5 % of each value in it."""
_QUANTILES: Final = {"p50": 0.5, "p99": 0.99, "p999": 0.999}
_FLUSH_AT: Final = 8192


@unique
class Stage(StrEnum):
    """Stages on the way of a record through the service."""

    QUEUE = "queue"
    """From the receipt until the loop drains the queue."""
    DECODE = "decode"
    DETECT = "detect"
    TOTAL = "total"
    """From the receipt to the outcome: the sum of the three before."""
    INTENDED = "intended"
    """From the event time, when a load generator means to send, to the outcome; as exact as the clock of the sender."""
    PUBLISH = "publish"
    """Building the messages of one iteration and queueing them for publication."""


class Iteration(NamedTuple):
    """The times of one iteration of the loop, and of its B records."""

    received_us: I64
    """(B,) local time of reception."""
    sent_us: I64
    """(B,) event time, in Unix time."""
    drained_us: int
    """Local time at which the iteration began."""
    clock_offset_us: int
    """From local to Unix time."""
    decode_us: float
    detect_us: float
    publish_us: float


class Histogram:
    """Counts by bucket; the last one is for values above the edges."""

    def __init__(self) -> None:
        self.counts: I64 = np.zeros(EDGES_US.size + 1, dtype=np.int64)
        self.sum_us = 0.0

    def add(self, values_us: F64) -> None:
        """Count each value."""
        self.counts += np.bincount(np.searchsorted(EDGES_US, values_us), minlength=self.counts.size)
        self.sum_us += float(values_us.sum())


class Latencies:
    """A histogram for each stage, in records."""

    def __init__(self) -> None:
        self.stages = {stage: Histogram() for stage in Stage}
        self._iterations: list[Iteration] = []
        self._held = 0
        self._reported = self.stages[Stage.TOTAL].counts.copy()
        self._max_us = 0.0

    def record(self, iteration: Iteration) -> None:
        """Count one iteration."""
        if not iteration.received_us.size:
            return
        self._iterations.append(iteration)
        self._held += iteration.received_us.size
        if self._held >= _FLUSH_AT:
            self.flush()

    def flush(self) -> None:
        """Bring the histograms up to date."""
        of, self._iterations, self._held = self._iterations, [], 0
        if not of:
            return
        sizes = [iteration.received_us.size for iteration in of]
        times_us = np.array([iteration[2:] for iteration in of], np.float64)
        drained_us, offset_us, decode_us, detect_us, publish_us = np.repeat(times_us, sizes, axis=0).T
        judged_us = drained_us + decode_us + detect_us
        received_us = np.concatenate([iteration.received_us for iteration in of])
        totals_us = judged_us - received_us
        ages_us = judged_us + offset_us - np.concatenate([iteration.sent_us for iteration in of])
        for stage, values_us in (
            (Stage.QUEUE, drained_us - received_us),
            (Stage.DECODE, decode_us),
            (Stage.DETECT, detect_us),
            (Stage.TOTAL, totals_us),
            (Stage.INTENDED, ages_us),
            (Stage.PUBLISH, publish_us),
        ):
            self.stages[stage].add(values_us)
        self._max_us = max(self._max_us, float(totals_us.max()))

    def percentiles_ms(self) -> Mapping[str, float]:
        """Return p50, p99, p999 and max of the total since the last call, to 5 %; empty without records."""
        self.flush()
        total = self.stages[Stage.TOTAL].counts
        recent = total - self._reported
        if not recent.any():
            return {}
        self._reported = total.copy()
        largest_us, self._max_us = self._max_us, 0.0
        cumulated = recent.cumsum()
        at = {name: int(np.searchsorted(cumulated, q * cumulated[-1])) for name, q in _QUANTILES.items()}
        return {name: min(_MIDDLES[i], largest_us) / 1e3 for name, i in at.items()} | {"max": largest_us / 1e3}

    def cumulative_us(self) -> dict[str, tuple[tuple[float, int], ...]]:
        """Return (upper edge, count) of the used buckets by stage; values above the last edge count at twice it."""
        self.flush()
        return {
            stage.value: tuple((_UPPER_US[i], int(histogram.counts[i])) for i in np.flatnonzero(histogram.counts))
            for stage, histogram in self.stages.items()
        }
