"""The clock as a dependency: the loop reads this and no other clock, so a test can replace it."""

import time
from typing import Protocol


class Clock(Protocol):
    """Wall time for timestamps, monotonic time for durations, and local time that is both."""

    def wall_us(self) -> int:
        """Microseconds of Unix time; it leaps when somebody sets the clock."""
        ...

    def local_us(self) -> int:
        """Microseconds of Unix time at the start, and the monotonic time since: it never leaps."""
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

    def __init__(self) -> None:
        self._start_ns = time.time_ns() - time.monotonic_ns()

    def wall_us(self) -> int:
        """Microseconds of Unix time; it leaps when somebody sets the clock."""
        return time.time_ns() // 1000

    def local_us(self) -> int:
        """Microseconds of Unix time at the start, and the monotonic time since: it never leaps."""
        return (self._start_ns + time.monotonic_ns()) // 1000
