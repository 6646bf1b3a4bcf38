"""The states of vehicles, as views show them."""

import pytest
from core.traffic import Platoon

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig


def test_the_offset_is_how_far_the_newest_location_is_from_the_estimate() -> None:
    platoon, engine = Platoon(3), Engine(DetectorConfig(vehicle_capacity=8))
    for _ in range(300):
        engine.step(platoon.next(), platoon.t_us)
    for _ in range(5):
        engine.step(platoon.next({"car1": 12.0}), platoon.t_us)
    states = engine.states()
    offset_m = dict(zip(states.followers, states.offset_m, strict=True))
    assert offset_m["car1"] == pytest.approx(12.0, abs=0.5)
    assert abs(offset_m["car0"]) < 0.3
    assert abs(offset_m["car2"]) < 0.3
