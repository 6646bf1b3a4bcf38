"""Open misses: from the onset to the end of a silence."""

import numpy as np
from numpy.typing import NDArray

from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import I64
from headway.core.types.records import Kind, Sensor
from headway.core.types.snapshot import OpenMiss
from headway.core.types.step_result import AnomalyEvent, Phase


class MissLog:
    """Open misses by row."""

    def __init__(self, vehicles: VehicleTable, capacity: int) -> None:
        self._vehicles = vehicles
        self._open: dict[int, OpenMiss] = {}
        self.active: NDArray[np.bool_] = np.zeros(capacity, np.bool_)

    def __len__(self) -> int:
        """Return the number of open misses."""
        return len(self._open)

    def start(self, row: int, leader: int, t_us: int, last_received_us: int, now_us: int) -> AnomalyEvent:
        """Open the miss of a row, silent since its message of event time `t_us`, received at `last_received_us`."""
        self._open[row] = OpenMiss(row, f"{self._vehicles.id_of[row]}-{t_us}-{Kind.MISS.label}", t_us)
        self.active[row] = True
        return self._event(Phase.ONSET, row, leader, t_us, last_received_us, now_us)

    def end(self, row: int, leader: int, t_us: int, last_received_us: int, now_us: int) -> AnomalyEvent:
        """Close the miss of a row that reappeared, or is evicted."""
        event = self._event(Phase.CLEARED, row, leader, t_us, last_received_us, now_us)
        del self._open[row]
        self.active[row] = False
        return event

    def drop(self, row: int) -> None:
        """Close the miss of a row, if any, without an event update."""
        self._open.pop(row, None)
        self.active[row] = False

    def snapshot(self, rows: I64) -> list[OpenMiss]:
        """Return the open misses of `rows` (n,)."""
        return [self._open[row] for row in rows[self.active[rows]].tolist()]

    def restore(self, misses: list[OpenMiss]) -> None:
        """Open these misses without an event update."""
        for miss in misses:
            self._open[miss.row] = miss
            self.active[miss.row] = True

    def _event(
        self, phase: Phase, row: int, leader: int, t_us: int, last_received_us: int, now_us: int
    ) -> AnomalyEvent:
        suspect = self._vehicles.id_of[row]
        assert suspect is not None
        return AnomalyEvent(
            event_id=self._open[row].event_id,
            phase=phase,
            kind=Kind.MISS,
            sensor=Sensor.BOTH,
            confidence=1.0,
            suspect=suspect,
            leader=self._vehicles.id_of[leader] if leader >= 0 else None,
            follower=suspect,
            t_us=t_us,
            onset_us=self._open[row].onset_us,
            received_us=last_received_us,
            detected_us=now_us,
        )
