"""A surge: for a while more vehicles send than the service can hold. What it did meanwhile, and when it was over it.

Read off the service's own reports, one a second: the latency of each second is what its histogram gained.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from headway_loadtest.measure.percentiles import Percentiles, of_buckets
from headway_loadtest.measure.subscriber import Health
from headway_loadtest.traffic.surge import Surge

NORMAL_FACTOR = 2.0
"""A second is normal again when its p99 is at most so many times that of the worst second before."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Surged:
    """What a surge came to."""

    vehicles: int
    seconds: float
    latency: Percentiles | None
    """Of the records processed during the surge, from the intended send time."""
    judged_hz: float
    lost: int
    """Records shed during the surge and until it was over."""
    normal_p99_ms: float | None
    """What counts as normal; None: no report came before."""
    recovered_s: float | None
    """From the end of the surge until a normal second began, to a second; None: none did."""


def assess_surge(reports: Sequence[Health], surge: Surge, stage: str, *, warm_ns: int, start_ns: int) -> Surged:
    """Judge a surge from the reports of one instance, oldest first; the replay began at `start_ns` (monotonic)."""
    began_ns, over_ns = (start_ns + round(at_s * 1e9) for at_s in (surge.start_s, surge.stop_s))
    before = [one for one in pairwise(reports) if warm_ns <= one[0].received_ns and one[1].received_ns <= began_ns]
    worst = [gained.p99 for one in before if (gained := _gained(*one, stage)) is not None]
    normal_ms = NORMAL_FACTOR * max(worst) if worst else None
    during = [report for report in reports if began_ns <= report.received_ns <= over_ns]
    return Surged(
        vehicles=surge.vehicles,
        seconds=surge.seconds,
        latency=_gained(during[0], during[-1], stage) if len(during) > 1 else None,
        judged_hz=_judged_hz(during[0], during[-1]) if len(during) > 1 else 0.0,
        lost=_lost(during[0], reports[-1]) if during else 0,
        normal_p99_ms=normal_ms,
        recovered_s=next(
            (
                max(0.0, (first.received_ns - over_ns) / 1e9)
                for first, second in pairwise(reports)
                if normal_ms is not None
                and second.received_ns > over_ns
                and (gained := _gained(first, second, stage)) is not None
                and gained.p99 <= normal_ms
                and not _lost(first, second)
            ),
            None,
        ),
    )


def _gained(first: Health, second: Health, stage: str) -> Percentiles | None:
    before, after = (dict(report.content.get("histograms_us", {}).get(stage, ())) for report in (first, second))
    return of_buckets(before, after)


def _lost(first: Health, second: Health) -> int:
    return sum(second.counters.lost.values()) - sum(first.counters.lost.values())


def _judged_hz(first: Health, second: Health) -> float:
    processed = second.counters.scored + second.counters.warming - first.counters.scored - first.counters.warming
    return 1e9 * processed / (second.received_ns - first.received_ns)
