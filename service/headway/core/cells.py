"""One site on several engines: each has its cells of the site and the vehicles around them.

An engine receives the vehicles in its cells and, for the pairs at their border, those in the halo around them. Each
vehicle has one owner, which publishes and counts it: the engine of the cell in which the vehicle is. When that changes,
the vehicle goes over with its state. An engine into whose halo a vehicle comes gets a copy of the state. So no vehicle
warms up twice.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import reduce
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from headway.core.tracking.cells import Lattice
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import I64, Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.step_result import StepResult
from headway.core.types.vehicle_state import VehicleState

_STAYS_US = 1_000_000
"""Least time of a vehicle with one owner: a false position that alternates does not move it with each message."""
_LEAVES_US = 1_000_000
"""A vehicle silent for so much longer than the engines keep it is dropped here too."""
_TABLE_EVERY_US = 1_000_000


class Part(Protocol):
    """One engine; each call returns what waits for the result, so that several work at once."""

    def states(self, vehicles: Sequence[str], released: Sequence[bool]) -> Callable[[], list[VehicleState | None]]:
        """Return the states of these vehicles; `released` are those that another engine publishes from now on."""
        ...

    def step(self, request: "PartStep") -> Callable[[], StepResult]:
        """Adopt vehicles, then step."""
        ...


@dataclass(frozen=True, slots=True)
class PartStep:
    """What one engine does in one step."""

    adopted: Sequence[tuple[VehicleState, bool]]
    """States, and whether this engine publishes the vehicle."""
    batch: Batch
    owned: NDArray[np.bool_]
    now_us: int | None
    clock_offset_us: int


class CellDispatch:
    """Takes each record to the engines of its place, and vehicles from engine to engine."""

    def __init__(self, config: DetectorConfig, lattice: Lattice, parts: Sequence[Part]) -> None:
        self._lattice = lattice
        self._parts = parts
        self._ttl_us = int(config.vehicle_ttl_s * 1e6) + _LEAVES_US
        capacity = config.vehicle_capacity
        self._vehicles = VehicleTable(capacity)
        self._owner: I64 = np.zeros(capacity, np.int64)
        self._known: I64 = np.zeros(capacity, np.int64)
        """(C,) engines that know the vehicle up to its last message, as bits."""
        self._moved_us: I64 = np.zeros(capacity, np.int64)
        self._received_us: I64 = np.zeros(capacity, np.int64)
        self._swept_us = 0
        self.records = 0
        """Records so far,"""
        self.copies = 0
        """and how often they were given to an engine."""
        self.handovers = 0

    def step(self, batch: Batch, now_us: int | None = None, clock_offset_us: int = 0) -> StepResult:
        """Do what `Engine.step` does, on all engines; outcome and events of a vehicle are those of its owner."""
        owners, receivers = self._assign(batch)
        adopted = self._hand_over(batch, owners, receivers)
        places = [np.flatnonzero(receivers >> k & 1) for k in range(len(self._parts))]
        waiting = [
            part.step(PartStep(adopted[k], _take(batch, places[k]), owners[places[k]] == k, now_us, clock_offset_us))
            for k, part in enumerate(self._parts)
        ]
        results = [wait() for wait in waiting]
        outcomes = np.empty(len(batch), np.uint8)
        for k, result in enumerate(results):
            mine = owners[places[k]] == k
            outcomes[places[k][mine]] = result.outcomes[mine]
        self.records += len(batch)
        self.copies += sum(place.size for place in places)
        self._sweep(batch, now_us)
        return reduce(_add, results, StepResult(outcomes=outcomes))

    def forget(self, part: int, kept: Sequence[str]) -> None:
        """Take note that an engine started again and knows only the vehicles `kept`, as their owner."""
        self._known &= ~(1 << part)
        rows = self._vehicles.rows(id_column(kept))
        unknown = [vehicle for vehicle, row in zip(kept, rows.tolist(), strict=True) if row < 0]
        admitted = self._vehicles.admit(unknown)
        rows = np.concatenate([rows[rows >= 0], np.array(admitted, np.int64)])
        self._owner[rows], self._known[rows] = part, 1 << part

    def _assign(self, batch: Batch) -> tuple[I64, I64]:
        """Return (B,) the owner of the vehicle of each record, before it changes, and the engines that receive it."""
        lat_deg, lon_deg = np.asarray(batch.lat_deg, float), np.asarray(batch.lon_deg, float)
        homes, receivers = self._lattice.owners(lat_deg, lon_deg), self._lattice.receivers(lat_deg, lon_deg)
        rows = self._vehicles.rows(batch.ids)
        new = np.flatnonzero(rows < 0)
        if new.size:
            first = dict(zip(batch.ids[new[::-1]].tolist(), new[::-1].tolist(), strict=True))
            order = list(first.items())[::-1]
            admitted = self._vehicles.admit([vehicle.decode() for vehicle, _ in order])
            at = [place for _, place in order[: len(admitted)]]
            self._owner[admitted], self._known[admitted] = homes[at], 0
            self._moved_us[admitted] = self._received_us[admitted] = batch.received_us[at]
            rows = self._vehicles.rows(batch.ids)
        owners = np.where(rows >= 0, self._owner[rows], homes)
        leaves = np.flatnonzero(
            (rows >= 0) & (homes != owners) & (batch.received_us - self._moved_us[rows] > _STAYS_US)
        )
        self._owner[rows[leaves]], self._moved_us[rows[leaves]] = homes[leaves], batch.received_us[leaves]
        known = rows >= 0
        self._received_us[rows[known]] = batch.received_us[known]
        return owners, receivers

    def _hand_over(self, batch: Batch, owners: I64, receivers: I64) -> list[list[tuple[VehicleState, bool]]]:
        """Update `owners` and `receivers`; return what each engine adopts, and whether as the owner."""
        rows = self._vehicles.rows(batch.ids)
        before = owners.copy()
        owners[rows >= 0] = self._owner[rows[rows >= 0]]
        receivers |= 1 << owners
        adopted: list[list[tuple[VehicleState, bool]]] = [[] for _ in self._parts]
        known = np.where(rows >= 0, self._known[rows], 0)
        moves = np.flatnonzero((known >> before & 1 > 0) & ((receivers & ~known > 0) | (owners != before)))
        _, first = np.unique(rows[moves], return_index=True)
        moves = moves[np.sort(first)]
        asked: list[list[int]] = [moves[before[moves] == k].tolist() for k in range(len(self._parts))]
        waiting = [
            part.states([batch.ids[i].decode() for i in asked[k]], [bool(owners[i] != k) for i in asked[k]])
            for k, part in enumerate(self._parts)
            if asked[k]
        ]
        given = dict(zip([i for of in asked for i in of], [state for wait in waiting for state in wait()], strict=True))
        for i in moves.tolist():
            state = given[i]
            for k in range(len(self._parts)):
                goes = owners[i] == k != before[i]
                if state is not None and (goes or (receivers[i] & ~known[i]) >> k & 1):
                    adopted[k].append((state, bool(owners[i] == k)))
            self.handovers += int(owners[i] != before[i])
        self._known[rows[rows >= 0]] = receivers[rows >= 0]
        return adopted

    def _sweep(self, batch: Batch, now_us: int | None) -> None:
        """Drop the vehicles that all engines have dropped."""
        newest_us = now_us if now_us is not None else int(batch.received_us[-1]) if len(batch) else 0
        if newest_us - self._swept_us < _TABLE_EVERY_US:
            return
        self._swept_us = newest_us
        for row in np.flatnonzero(self._vehicles.in_use & (newest_us - self._received_us > self._ttl_us)).tolist():
            self._vehicles.evict(row)


def _take(batch: Batch, places: I64) -> Batch:
    """Return the records of a batch at `places`."""
    return Batch(**{of.name: getattr(batch, of.name)[places] for of in fields(Batch)})


def _add(one: StepResult, other: StepResult) -> StepResult:
    """Return the sums of two results: outcomes of the first, events in the order of their detection."""
    return StepResult(
        outcomes=one.outcomes,
        events=sorted(one.events + other.events, key=lambda event: event.detected_us),
        nis=np.concatenate([one.nis, other.nis]),
        anomalous=one.anomalous + other.anomalous,
        sequence_gaps=one.sequence_gaps + other.sequence_gaps,
        repairs=one.repairs + other.repairs,
        restarts=one.restarts + other.restarts,
        evicted=one.evicted + other.evicted,
        leader_changes=one.leader_changes + other.leader_changes,
        resets=one.resets + other.resets,
        failures=one.failures + other.failures,
    )
