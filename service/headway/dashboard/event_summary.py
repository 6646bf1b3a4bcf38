"""An event as it is known now: its newest update, with what is the largest over all of its updates."""

from dataclasses import dataclass
from typing import Any, Final

from headway_schemas import Event, Phase, Sensor

_NEWEST: Final = {
    "event_id", "site", "phase", "kind", "sensor", "suspect", "leader", "follower", "count",
}  # fmt: skip


@dataclass(slots=True)
class EventSummary:
    """What a view shows of an event."""

    newest: Event
    first_us: int
    updates: int = 0
    worst: Event | None = None
    """The update with the highest statistic, if any has one."""
    deviation_m: float | None = None
    deviation_mps: float | None = None
    innovation_m: float = 0.0
    """The largest in absolute value, with its sign; 0: none."""
    innovation_mps: float = 0.0
    diagnosed: Event | None = None
    """The newest update with a confidence."""
    limited: Event | None = None
    """The newest update with observations."""
    led: Event | None = None
    """The newest update with a leader."""

    @classmethod
    def of(cls, event: Event) -> "EventSummary":
        """Return the summary of one update."""
        summary = cls(newest=event, first_us=_first_us(event))
        summary.add(event)
        return summary

    def add(self, event: Event, *, is_new: bool = True) -> None:
        """Add an update, or one that is not new but has gained evidence; they come in any order."""
        self.updates += is_new
        self.first_us = min(self.first_us, _first_us(event))
        self.newest = max(self.newest, event, key=_order)
        if event.confidence is not None:
            self.diagnosed = max(self.diagnosed or event, event, key=_order)
        if event.observations:
            self.limited = max(self.limited or event, event, key=_order)
        if event.leader is not None:
            self.led = max(self.led or event, event, key=_order)
        if event.statistic is not None:
            self.worst = max(self.worst or event, event, key=lambda update: update.statistic or 0.0)
        x_m, v_mps = deviation(event)
        self.deviation_m, self.deviation_mps = _larger(self.deviation_m, x_m), _larger(self.deviation_mps, v_mps)
        if event.innovation is not None:
            self.innovation_m = max(self.innovation_m, event.innovation.x_m or 0.0, key=abs)
            self.innovation_mps = max(self.innovation_mps, event.innovation.v_mps or 0.0, key=abs)

    def row(self) -> dict[str, Any]:
        """Return what the page is sent."""
        worst = self.worst or self.newest
        return self.newest.model_dump(mode="json", include=_NEWEST) | {
            "observations": [] if self.limited is None else list(self.limited.observations),
            "leader": self.led and self.led.leader,
            "first_us": self.first_us,
            "last_us": self.newest.detected_us,
            "updates": self.updates,
            "statistic": worst.statistic,
            "gate": worst.gate,
            "p_value": worst.p_value,
            "confidence": self.diagnosed and self.diagnosed.confidence,
            "deviation_m": self.deviation_m,
            "deviation_mps": self.deviation_mps,
            "ahead": self.innovation_m > 0 if self.innovation_m else None,
            "fast": self.innovation_mps > 0 if self.innovation_mps else None,
        }


def deviation(event: Event) -> tuple[float | None, float | None]:
    """Return the largest |reading - estimate| of location and speed that an update shows.

    An update without the field is of a service before it had one; there it is that of the update's own reading.
    """
    if event.deviation is not None:
        return event.deviation.x_m, event.deviation.v_mps
    if event.sensor is Sensor.LINK or event.evidence is None or event.recovered is None:
        return None, None
    reading = dict(zip(event.evidence.columns, event.evidence.readings[-1], strict=True))
    return _apart(reading["x_m"], event.recovered.x_m), _apart(reading["v_mps"], event.recovered.v_mps)


def _apart(a: float | None, b: float | None) -> float | None:
    return None if a is None or b is None else abs(a - b)


def _larger(a: float | None, b: float | None) -> float | None:
    return b if a is None else a if b is None else max(a, b)


def _first_us(event: Event) -> int:
    return event.detected_us if event.onset_us is None else event.onset_us


def _order(event: Event) -> tuple[int, bool]:
    return event.detected_us, event.phase is Phase.CLEARED
