"""Percentiles from intended send times: of our own measurements, and of the service's histograms."""

from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

QUANTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}
US_MAX = 600_000_000
_BITS = 11
"""Three digits."""


@dataclass(frozen=True, slots=True)
class Percentiles:
    """Milliseconds. `count` is how many were measured."""

    p50: float
    p99: float
    p999: float
    max: float
    count: int

    def to_json(self) -> dict[str, float]:
        """Return the four by name, rounded to a microsecond."""
        return {name: round(value, 3) for name, value in asdict(self).items() if name != "count"}


class Histogram:
    """Counts of microseconds to three digits: each value is rounded up in its leading bits."""

    def __init__(self) -> None:
        self.counts: Counter[float] = Counter()
        """By upper edge."""

    def add(self, value_us: int, times: int = 1) -> None:
        """Count one value several times."""
        value_us = min(max(value_us, 1), US_MAX)
        rest = (1 << max(0, value_us.bit_length() - _BITS)) - 1
        self.counts[value_us | rest] += times


def measure(latencies_us: Iterable[float]) -> Percentiles | None:
    """Percentiles of single measurements, to three digits; None where there are none."""
    histogram = Histogram()
    for value in latencies_us:
        histogram.add(round(value))
    return of_histogram(histogram)


def of_histogram(histogram: Histogram) -> Percentiles | None:
    """Percentiles of a histogram; None where it is empty."""
    return of_buckets({}, histogram.counts)


def of_buckets(before: Mapping[float, int], after: Mapping[float, int]) -> Percentiles | None:
    """Percentiles of what a cumulative histogram gained: counts by upper edge in microseconds.

    Each is the upper edge of its bucket, so never too low. None where nothing was gained.
    """
    gained = {edge: count - before.get(edge, 0) for edge, count in sorted(after.items())}
    gained = {edge: count for edge, count in gained.items() if count > 0}
    total = sum(gained.values())
    if not total:
        return None
    values = []
    for quantile in QUANTILES.values():
        rank = max(1, -(-total * quantile // 100))
        seen = 0
        for edge, count in gained.items():
            seen += count
            if seen >= rank:
                values.append(edge / 1e3)
                break
    p50, p99, p999 = values
    return Percentiles(p50, p99, p999, max(gained) / 1e3, total)
