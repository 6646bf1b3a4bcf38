"""A site on several engines gives what it gives on one."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from core.site.dense_road import dense_road

from headway.core.cells import CellDispatch, PartStep
from headway.core.engine import Engine
from headway.core.tracking.cells import Lattice
from headway.core.types.config import DetectorConfig
from headway.core.types.step_result import AnomalyEvent, StepResult
from headway.core.types.vehicle_state import VehicleState

CONFIG = DetectorConfig(vehicle_capacity=256)


class EnginePart:
    """An engine in this process."""

    def __init__(self) -> None:
        self.engine = Engine(CONFIG)

    def states(self, vehicles: Sequence[str], released: Sequence[bool]) -> Callable[[], list[VehicleState | None]]:
        of = zip(vehicles, released, strict=True)
        states = [self.engine.release(name) if goes else self.engine.state_of(name) for name, goes in of]
        return lambda: states

    def step(self, request: PartStep) -> Callable[[], StepResult]:
        for state, owned in request.adopted:
            assert self.engine.adopt(state, owned=owned)
        result = self.engine.step(request.batch, request.now_us, request.clock_offset_us, owned=request.owned)
        return lambda: result


def summary(event: AnomalyEvent) -> tuple[object, ...]:
    return event.event_id, event.phase, event.kind, event.suspect, event.follower, event.t_us


@pytest.mark.parametrize("engines", [2, 3])
def test_all_outcomes_and_events_are_those_of_one_engine(engines: int) -> None:
    road = dense_road(cars=200, lanes=4, seconds=100.0)
    one, parts = Engine(CONFIG), [EnginePart() for _ in range(engines)]
    site = CellDispatch(CONFIG, Lattice(engines, 1000.0, 300.0), parts)
    expected, found, sums = [], [], np.zeros((2, 3), int)
    for records in road:
        by_one, by_cells = one.step(records), site.step(records)
        assert by_cells.outcomes.tolist() == by_one.outcomes.tolist()
        sums += [[r.nis.size, r.anomalous, r.sequence_gaps] for r in (by_one, by_cells)]
        expected += map(summary, by_one.events)
        found += map(summary, by_cells.events)
    assert sorted(found) == sorted(expected)
    assert len({name for name, *_ in expected if str(name).endswith("-link")}) >= 10
    assert sums[0].tolist() == sums[1].tolist()
    assert site.handovers > 100
    assert sum(part.engine.vehicles for part in parts) == one.vehicles == 200
    together = [name for part in parts for name in part.engine.states().followers]
    assert sorted(together) == sorted(one.states().followers)


def test_an_engine_that_starts_again_is_given_what_its_neighbours_know() -> None:
    road, parts = dense_road(cars=40, lanes=2, seconds=20.0), [EnginePart() for _ in range(2)]
    site = CellDispatch(CONFIG, Lattice(2, 1000.0, 300.0), parts)
    for records in road[:100]:
        site.step(records)
    parts[1].engine = Engine(CONFIG)
    site.forget(1, [])
    for records in road[100:]:
        result = site.step(records)
    assert sum(part.engine.vehicles for part in parts) == 40
    assert result.outcomes.size == 40


def test_a_position_that_alternates_moves_its_vehicle_once_a_second_at_most() -> None:
    road, parts = dense_road(cars=2, lanes=1, seconds=20.0), [EnginePart() for _ in range(2)]
    site = CellDispatch(CONFIG, Lattice(2, 1000.0, 300.0), parts)
    for k, records in enumerate(road):
        records.lat_deg[records.ids == b"car1"] += 0.009 * (k % 2)
        site.step(records)
    assert site.handovers <= 22
