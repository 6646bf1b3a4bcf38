"""The result of a run."""

from collections.abc import Mapping
from dataclasses import dataclass

from headway_loadtest.measure.accounting import Ledger
from headway_loadtest.measure.detection import Quality
from headway_loadtest.measure.overload import Surged
from headway_loadtest.measure.percentiles import Percentiles

INTENDED = "intended"
"""The service's stage from a message's event time to its outcome."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Service:
    """The service by its own reports. Costs and latencies are since the warm-up; None: not reported."""

    instance: str
    ledger: Ledger
    stages: Mapping[str, Percentiles]
    cpu_us: float | None
    """Per record."""
    rss_mb: float | None
    rss_warm_mb: float | None
    rss_minute_mb: float | None = None
    """A minute after the start, for what runs longer."""
    surged: Surged | None = None

    @property
    def rss_ratio(self) -> float | None:
        """Memory at the end by that after a minute."""
        return self.rss_mb / self.rss_minute_mb if self.rss_mb and self.rss_minute_mb else None


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """The result of a run. `service` is None if no service reported on the site."""

    vehicles: int
    seconds: float
    warmup_s: float
    speed: float
    sent: int
    late: Percentiles | None
    """Of the generator itself, since the warm-up."""
    stalled_s: float
    generator_cpu_us: float
    """Per record."""
    alert_latency: Percentiles | None
    """From the intended send time of the first reading in doubt until a subscriber has the alert."""
    alerts: int
    unread: int
    quality: Quality
    service: Service | None

    @property
    def latency(self) -> Percentiles | None:
        """From the intended send time to the outcome; unknown unless `speed` is 1."""
        return self.service.stages.get(INTENDED) if self.service and self.speed == 1.0 else None
