"""Time, as a thing that can be handed in: the loop reads this and no other clock."""

import time
from typing import Protocol


class Clock(Protocol):
    """Wall time says when; monotonic time says how long."""

    def wall_us(self) -> int:
        """Microseconds of Unix time."""
        ...

    def monotonic_ns(self) -> int:
        """Nanoseconds that never run backwards."""
        ...

    def sleep(self, seconds: float) -> None:
        """Let others work."""
        ...


class SystemClock:
    """The machine's clocks."""

    monotonic_ns = staticmethod(time.monotonic_ns)
    sleep = staticmethod(time.sleep)

    def wall_us(self) -> int:
        """Microseconds of Unix time."""
        return time.time_ns() // 1000
