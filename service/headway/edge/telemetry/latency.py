"""Latency of records by stage, in histograms that are cheap to fill."""

import math
from bisect import bisect_left
from collections.abc import Mapping
from enum import StrEnum, unique
from typing import Final

import numpy as np
from numpy.typing import NDArray

I64 = NDArray[np.int64]

_PER_DECADE: Final = 24
EDGES_US: Final = 10.0 * 10.0 ** (np.arange(7 * _PER_DECADE + 1) / _PER_DECADE)
"""Upper edges of the buckets, 10 us to 100 s, each a tenth wider than the one before."""
_EDGES: Final = EDGES_US.tolist()
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


class Histogram:
    """Counts by bucket; the last one is for values above the edges."""

    def __init__(self) -> None:
        self.counts: I64 = np.zeros(EDGES_US.size + 1, dtype=np.int64)
        self.sum_us = 0.0

    def add(self, value_us: float, times: int) -> None:
        """Count one value several times."""
        self.counts[bisect_left(_EDGES, value_us)] += times
        self.sum_us += value_us * times

    def add_all(self, values_us: NDArray[np.float64]) -> None:
        """Count each value once."""
        self.counts += np.bincount(np.searchsorted(EDGES_US, values_us), minlength=self.counts.size)
        self.sum_us += float(values_us.sum())


class Latencies:
    """A histogram for each stage, in records."""

    def __init__(self) -> None:
        self.stages = {stage: Histogram() for stage in Stage}
        self._waits: list[NDArray[np.float64]] = []
        self._works: list[NDArray[np.float64]] = []
        self._ages: list[NDArray[np.float64]] = []
        self._held = 0
        self._reported = self.stages[Stage.TOTAL].counts.copy()
        self._max_us = 0.0

    def record(
        self,
        waits_us: NDArray[np.float64],
        ages_us: NDArray[np.float64],
        decode_us: float,
        detect_us: float,
        publish_us: float,
    ) -> None:
        """Count one iteration: (B,) queue time and age at the outcome of each record, and the time of each stage."""
        size = waits_us.size
        if not size:
            return
        self.stages[Stage.DECODE].add(decode_us, size)
        self.stages[Stage.DETECT].add(detect_us, size)
        self.stages[Stage.PUBLISH].add(publish_us, size)
        self._waits.append(waits_us)
        self._works.append(waits_us + (decode_us + detect_us))
        self._ages.append(ages_us)
        self._held += size
        if self._held >= _FLUSH_AT:
            self.flush()

    def flush(self) -> None:
        """Bring the histograms up to date."""
        if self._held:
            totals_us = np.concatenate(self._works)
            self.stages[Stage.QUEUE].add_all(np.concatenate(self._waits))
            self.stages[Stage.TOTAL].add_all(totals_us)
            self._max_us = max(self._max_us, float(totals_us.max()))
            self.stages[Stage.INTENDED].add_all(np.concatenate(self._ages))
            self._ages.clear()
            self._waits.clear()
            self._works.clear()
            self._held = 0

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
        edges = [*_EDGES, 2 * _EDGES[-1]]
        return {
            stage.value: tuple((edges[i], int(histogram.counts[i])) for i in np.flatnonzero(histogram.counts))
            for stage, histogram in self.stages.items()
        }
