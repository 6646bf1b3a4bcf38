"""Event updates that a subscriber has not received, by the numbers that each instance gives its updates."""

from typing import Final

from headway_schemas.event import Event

_REORDERED_US: Final = 1_000_000
"""Updates overtake each other by less than this."""


class SequenceGaps:
    """Finds gaps in the `sequence` of each instance; a subscriber asks the history for what is in them."""

    def __init__(self) -> None:
        self._newest: dict[tuple[str, str], tuple[int, int]] = {}

    def missing_after(self, event: Event) -> int | None:
        """Take an update as it was received; return the number after which updates are missing, None if none is.

        A lower number of a later time means that the instance lost its journal and counts from one again.
        """
        if event.sequence is None or event.instance is None:
            return None
        key = event.site, event.instance
        number, detected_us = self._newest.get(key, (event.sequence, event.detected_us))
        restarted = event.sequence <= number and event.detected_us > detected_us + _REORDERED_US
        if event.sequence > number or restarted or key not in self._newest:
            self._newest[key] = event.sequence, event.detected_us
        return number if event.sequence > number + 1 else None
