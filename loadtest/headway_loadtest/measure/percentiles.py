"""Percentiles from intended send times: of our own measurements, and of the service's histograms."""

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass

from hdrh.histogram import HdrHistogram

QUANTILES = {"p50": 50.0, "p99": 99.0, "p999": 99.9}
US_MAX = 600_000_000


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


def measure(latencies_us: Iterable[float]) -> Percentiles | None:
    """Percentiles of single measurements, to three digits; None where there are none."""
    histogram = HdrHistogram(1, US_MAX, 3)
    for value in latencies_us:
        histogram.record_value(min(max(round(value), 1), US_MAX))
    return of_histogram(histogram)


def of_histogram(histogram: HdrHistogram) -> Percentiles | None:
    """Percentiles of a histogram of microseconds; None where it is empty."""
    if not histogram.get_total_count():
        return None
    p50, p99, p999 = (histogram.get_value_at_percentile(q) / 1e3 for q in QUANTILES.values())
    return Percentiles(p50, p99, p999, histogram.get_max_value() / 1e3, histogram.get_total_count())


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
