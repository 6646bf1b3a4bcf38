"""A surge: for a while more vehicles than the service can hold."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class Surge:
    """`vehicles` more, from `start_s` of replay time on, for `seconds`."""

    vehicles: int
    start_s: float
    seconds: float

    @property
    def stop_s(self) -> float:
        """When they have gone."""
        return self.start_s + self.seconds
