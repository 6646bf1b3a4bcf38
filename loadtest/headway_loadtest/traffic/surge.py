"""A surge: for some time more vehicles than the service can process."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Surge:
    """`vehicles` more, from `start_s` of replay time on, for `seconds`."""

    vehicles: int
    start_s: float
    seconds: float

    @property
    def stop_s(self) -> float:
        """End of the surge in replay time."""
        return self.start_s + self.seconds
