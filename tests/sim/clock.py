"""Time that moves only when a test moves it."""

START_US = 1_700_000_000_000_000


class FakeClock:
    """Wall and monotonic time in step, in whole microseconds; `sleep` moves both on."""

    def __init__(self) -> None:
        self._elapsed_us = self._leapt_us = 0

    def wall_us(self) -> int:
        return START_US + self._elapsed_us + self._leapt_us

    def local_us(self) -> int:
        return START_US + self._elapsed_us

    def monotonic_ns(self) -> int:
        return 1_000 * self._elapsed_us

    def sleep(self, seconds: float) -> None:
        self._elapsed_us += round(seconds * 1e6)

    def leap(self, by_us: int) -> None:
        """Set the wall clock ahead or back; the monotonic one goes on."""
        self._leapt_us += by_us
