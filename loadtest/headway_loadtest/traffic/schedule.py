"""Open loop: the intended send time of each message, whatever happened to the ones before it.

Event time runs `speed` times as fast as the wall clock and ends at now: a replay of `span_s` seconds of driving begins
span_s (1 - 1 / speed) in the past. Messages go out at the first whole millisecond at or after their event time, the
resolution of the J2735 secMark; at speed 1 a synthetic vehicle's event time is its intended send time exactly.
Instants on the monotonic clock are nanoseconds; the wall clock is read once, at the start.
"""

from dataclasses import dataclass

import numpy as np

from headway_loadtest.sources.drive import I64

TICK_NS = 1_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Schedule:
    """Times of a replay that starts at `start_ns` (monotonic), which the wall clock calls `start_unix_us`."""

    start_ns: int
    start_unix_us: int
    speed: float = 1.0
    span_s: float = 0.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.speed) and self.speed > 0):
            raise ValueError(f"speed is a factor above 0, not {self.speed:g}")

    @property
    def first_event_us(self) -> int:
        """Event time of the start, microseconds Unix."""
        return self.start_unix_us - round(self.span_s * 1e6 * (1.0 - 1.0 / self.speed))

    def event_us(self, t_us: I64) -> I64:
        """Event times, microseconds Unix, of messages at `t_us` of the replay."""
        return t_us + self.first_event_us

    def due_ns(self, t_us: I64) -> I64:
        """Return the intended send times, monotonic, of messages at `t_us` of the replay."""
        after_ns = np.round(t_us * (1000.0 / self.speed)).astype(np.int64)
        return self.start_ns + -(-after_ns // TICK_NS) * TICK_NS

    def event_at_us(self, now_ns: int) -> float:
        """Event time, microseconds Unix, at an instant of the monotonic clock."""
        return self.first_event_us + (now_ns - self.start_ns) * self.speed / 1e3

    def due_of_event_ns(self, event_us: int) -> int:
        """Return the intended send time of the message with that event time."""
        return int(self.due_ns(np.array([event_us - self.first_event_us]))[0])
