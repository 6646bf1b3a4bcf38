"""The clock as a dependency: the loop reads this and no other clock, so a test can replace it."""

import time
from typing import Protocol


class Clock(Protocol):
    """Wall time for timestamps, monotonic time for durations."""

    def wall_us(self) -> int:
        """Microseconds of Unix time."""
        ...

    def monotonic_ns(self) -> int:
        """Nanoseconds that never run backwards."""
        ...

    def sleep(self, seconds: float) -> None:
        """Wait; other threads run meanwhile."""
        ...


class SystemClock:
    """The machine's clocks."""

    monotonic_ns = staticmethod(time.monotonic_ns)
    sleep = staticmethod(time.sleep)

    def wall_us(self) -> int:
        """Microseconds of Unix time."""
        return time.time_ns() // 1000
