"""The state of one vehicle as a value, from which another engine continues."""

from dataclasses import dataclass
from typing import Any, NamedTuple

from numpy.typing import NDArray

from headway.core.types.snapshot import OpenEvent, OpenMiss


class Neighbours(NamedTuple):
    """Other vehicles that the state refers to, by id, because each engine has rows of its own; None for none."""

    leader: str | None
    candidate: str | None
    declared: str | None
    """The leader that the last message declares."""
    overlapped: str | None
    tested: str | None
    """The leader of the pair tests."""
    suspect: str | None
    """Of the open event that the vehicle's own readings raised,"""
    pair_suspect: str | None
    """and of that of the pair tests."""


@dataclass(frozen=True, slots=True, kw_only=True)
class VehicleState:
    """One vehicle of an engine; only an engine of the same configuration and the same core can continue with it.

    Evidence is not included: it starts where the state is taken up, so later event updates can be replayed.
    """

    vehicle: str
    tables: dict[str, NDArray[Any]]
    """Copies (1,) of its row of each table, by its name. Rows of other vehicles in them have no meaning."""
    neighbours: Neighbours
    leader_place: tuple[int, float]
    """Event time (us) and odometer (m) of the leader's newest reading; zeros without a leader."""
    event: OpenEvent | None
    pair_event: OpenEvent | None
    miss: OpenMiss | None
    cleared_us: tuple[int, int]
    """Event time at which the newest event of each of both logs ended; 0: none did."""
