"""The state of some vehicles of an engine as values, from which another engine continues."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import I64


class OpenEvent(NamedTuple):
    """An open event."""

    row: int
    event_id: str
    suspect: int
    """Row of the vehicle that the event names."""
    onset_us: int
    """Event time of the reading with which it began."""
    kind: int
    sensor: int
    updated_us: int
    """Event time of the last event update."""
    changed: bool
    """Whether kind or sensor changed since."""
    readings_below_gate: int
    """In a row, up to now."""
    kind_published: bool
    """Whether an event update has named the kind."""
    deviation_m: float
    """Largest |reading - estimate| of the location."""
    deviation_mps: float
    """The same of the speed."""
    confidence: float
    """Probability of kind and sensor."""


class OpenMiss(NamedTuple):
    """An open miss."""

    row: int
    event_id: str
    onset_us: int
    """Event time of the last message before it."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Snapshot:
    """Some vehicles of an engine; only an engine of the same configuration and the same core can restore them.

    Evidence is not included. After a restore it starts at the restored rows, so later event updates can be replayed.
    """

    rows: I64
    """(n,) rows of the vehicles."""
    ids: list[str]
    tables: dict[str, NDArray[Any]]
    """Copies (n,) of the rows of each table, by its name."""
    events: list[OpenEvent]
    pair_events: list[OpenEvent]
    misses: list[OpenMiss]


def concatenate(parts: Sequence[Snapshot]) -> Snapshot:
    """Return one snapshot of the vehicles of all `parts`, at least one."""
    return Snapshot(
        rows=np.concatenate([part.rows for part in parts]),
        ids=[name for part in parts for name in part.ids],
        tables={name: np.concatenate([part.tables[name] for part in parts]) for name in parts[0].tables},
        events=[event for part in parts for event in part.events],
        pair_events=[event for part in parts for event in part.pair_events],
        misses=[miss for part in parts for miss in part.misses],
    )
