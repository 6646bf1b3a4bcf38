"""What an engine knows of some vehicles, as values: enough for another engine to go on with them."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import I64


class OpenEvent(NamedTuple):
    """An event under way."""

    row: int
    event_id: str
    kind: int
    sensor: int
    updated_us: int
    """Event time of the last statement."""
    changed: bool
    """Whether kind or sensor have become others since."""
    readings_below_gate: int
    """Readings without an alarm since the last one with."""


class OpenMiss(NamedTuple):
    """A miss under way."""

    row: int
    event_id: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """Some vehicles of an engine. Only an engine of the same configuration and the same core can go on with them.

    Evidence is left out: it begins anew at the rows as they are here, so that what is stated later can be replayed.
    """

    rows: I64
    """(n,) rows of the vehicles."""
    ids: list[str]
    tables: dict[str, NDArray[Any]]
    """(n,) of each table by its name, copies."""
    events: list[OpenEvent]
    pair_events: list[OpenEvent]
    misses: list[OpenMiss]


def concatenate(parts: Sequence[Snapshot]) -> Snapshot:
    """Return one snapshot of all the vehicles in `parts`, of which there is at least one."""
    return Snapshot(
        rows=np.concatenate([part.rows for part in parts]),
        ids=[name for part in parts for name in part.ids],
        tables={name: np.concatenate([part.tables[name] for part in parts]) for name in parts[0].tables},
        events=[event for part in parts for event in part.events],
        pair_events=[event for part in parts for event in part.pair_events],
        misses=[miss for part in parts for miss in part.misses],
    )
