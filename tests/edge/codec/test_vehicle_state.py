"""A state as bytes is the same state; damaged, foreign and forged ones are refused by name."""

from dataclasses import replace

import numpy as np
import pytest
from core.traffic import Platoon
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.vehicle_state import VehicleState
from headway.edge.codec.vehicle_state import Refusal, VehicleStateCodec

CONFIG = DetectorConfig(vehicle_capacity=8)
CODEC = VehicleStateCodec(CONFIG, {"version": "1"}, b"key")


def state_of(car: str, *, alarming: bool = True) -> VehicleState:
    platoon, engine = Platoon(5), Engine(CONFIG)
    for _ in range(80):
        engine.step(platoon.next())
    if alarming:
        engine.step(platoon.next({car: 9.0}))
    state = engine.state_of(car)
    assert state is not None
    return state


STATE = state_of("car2")
PAYLOAD = CODEC.encode(STATE, 5_000)


def test_bytes_are_the_same_state_in_the_local_time_of_the_receiver() -> None:
    again = CODEC.decode(PAYLOAD, 5_000)
    assert isinstance(again, VehicleState)
    assert STATE.event is not None
    assert {name: table.tobytes() for name, table in again.tables.items()} == {
        name: table.tobytes() for name, table in STATE.tables.items()
    }
    for name in ("vehicle", "neighbours", "leader_place", "pair_event", "miss", "cleared_us"):
        assert getattr(again, name) == getattr(STATE, name)
    assert again.event is not None
    assert again.event._replace(confidence=0.0) == STATE.event._replace(confidence=0.0)
    later = CODEC.decode(PAYLOAD, 2_000)
    assert isinstance(later, VehicleState)
    assert later.tables["tracks"]["received_us"] - STATE.tables["tracks"]["received_us"] == 3_000


def test_a_vehicle_with_a_leader_takes_about_five_kilobytes() -> None:
    assert 3_000 < len(PAYLOAD) < 7_000


@given(st.data())
@settings(max_examples=200, deadline=None)
def test_whatever_is_damaged_is_refused(data: st.DataObject) -> None:
    payload = bytearray(PAYLOAD)
    if data.draw(st.booleans()):
        payload = payload[: data.draw(st.integers(0, len(payload) - 1))]
    else:
        payload[data.draw(st.integers(0, len(payload) - 1))] ^= data.draw(st.integers(1, 255))
    assert CODEC.decode(bytes(payload), 0) is Refusal.DAMAGED


@given(st.binary(max_size=200))
@settings(max_examples=100, deadline=None)
def test_arbitrary_bytes_are_refused(payload: bytes) -> None:
    assert CODEC.decode(payload, 0) is Refusal.DAMAGED


@pytest.mark.parametrize(
    ("other", "reason"),
    [
        (VehicleStateCodec(CONFIG, {"version": "2"}, b"key"), Refusal.FOREIGN),
        (VehicleStateCodec(replace(CONFIG, model="aekf"), {"version": "1", "model": "aekf"}, b"key"), Refusal.FOREIGN),
        (VehicleStateCodec(CONFIG, {"version": "1"}, b"another"), Refusal.DAMAGED),
    ],
)
def test_a_state_of_another_service_is_refused(other: VehicleStateCodec, reason: Refusal) -> None:
    assert other.decode(PAYLOAD, 0) is reason


def test_an_engine_continues_from_the_bytes_with_the_open_event() -> None:
    engine, platoon = Engine(CONFIG), Platoon(5)
    platoon.k = 81
    state = CODEC.decode(PAYLOAD, 5_000)
    assert isinstance(state, VehicleState)
    assert engine.adopt(state)
    assert STATE.event is not None
    assert engine.open_event_ids == {STATE.event.event_id}
    result = engine.step(platoon.next())
    assert np.bincount(result.outcomes).tolist() == [1, 4]  # car2 does not warm up
