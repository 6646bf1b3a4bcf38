"""Message counts of vehicles whose messages have none."""

from typing import Final

_VEHICLES_MAX: Final = 100_000
"""Beyond it all count again from 0, so that memory is bounded."""


class MessageCounts:
    """Counts the messages of each vehicle, 0 to 127 and around."""

    def __init__(self) -> None:
        self._counts: dict[str, int] = {}

    def next(self, vehicle: str) -> int:
        """Return the count of the next message of a vehicle."""
        if len(self._counts) >= _VEHICLES_MAX:
            self._counts.clear()
        count = self._counts.get(vehicle, 0)
        self._counts[vehicle] = count + 1
        return count % 128
