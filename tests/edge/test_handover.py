"""A vehicle that enters the area of a neighbouring site goes over once, with its event; the rest is refused by name."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from core.traffic import LAT_DEG, METRES_PER_DEGREE, Platoon

from headway.core.engine import Engine
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.edge.handover import Area, Handed, Handover, HandoverConfig, read_config
from headway.edge.identity import Identity
from headway.errors import UserError

CONFIG = DetectorConfig(vehicle_capacity=8)
BORDER = LAT_DEG + 1120.0 / METRES_PER_DEGREE
"""The first car of the platoon is there after 60 steps."""
NORTH = Area(south=BORDER, west=-84.0, north=43.0, east=-82.0)
SOUTH = Area(south=41.0, west=-84.0, north=BORDER, east=-82.0)


class Site:
    """An engine and its hand-over."""

    def __init__(self, name: str, neighbour: str, area: Area, secret: str = "of sixteen letters") -> None:
        identity = Identity(
            site=name, instance="i", version="1", model="headway", config_hash="x", parameters={"version": "1"}
        )
        self.engine = Engine(CONFIG)
        config = HandoverConfig(secret=secret, neighbours={neighbour: area})
        self.handover = Handover(config, CONFIG, identity, self.engine)

    def step(self, records: Batch) -> tuple[Handed, dict[str, int]]:
        handed = self.handover.before_step(records, int(records.received_us[-1]), 0)
        result = self.engine.step(records, owned=handed.owned)
        return handed, dict(zip(records.ids.astype(str).tolist(), result.outcomes.tolist(), strict=True))


def test_each_vehicle_goes_over_at_the_border_and_does_not_warm_up() -> None:
    south, north, platoon = Site("south", "north", NORTH), Site("north", "south", SOUTH), Platoon(4)
    sent, events, opened, warming = [], set(), set(), 0
    for k in range(160):
        records = platoon.next({"car1": 9.0} if 66 <= k < 90 else None)
        inside = records.lat_deg >= BORDER
        handed, _ = south.step(records)
        opened |= south.engine.open_event_ids
        sent += [vehicle for _, vehicle, _ in handed.states]
        events |= set(handed.event_ids)
        there = Batch(**{name: getattr(records, name)[inside] for name in Batch.__dataclass_fields__})
        if len(there):
            _, outcomes = north.step(there)
            warming += sum(outcome == Outcome.WARMING for outcome in outcomes.values())
            opened |= north.engine.open_event_ids
        for site, _, payload in handed.states:
            assert site == "north"
            north.handover.receive("south", payload, int(records.received_us[-1]), 0)
    assert sent == platoon.ids
    assert north.handover.results["adopted"] == 4
    assert warming == 4  # the first record of each: its state comes after it
    assert (south.engine.vehicles, north.engine.vehicles) == (0, 4)
    assert events == opened
    assert len(events) == 1


def test_what_does_not_fit_is_refused_by_name() -> None:
    platoon, south = Platoon(1), Site("south", "north", NORTH)
    for _ in range(59):
        south.step(platoon.next())
    handed = [south.step(platoon.next())[0] for _ in range(5)]
    (_, _, payload), *_ = [state for of in handed for state in of.states]
    now_us = platoon.t_us
    forged = Site("south", "north", NORTH, "another of sixteen")
    for _ in range(3):
        north = Site("north", "south", SOUTH)
        north.handover.receive("elsewhere", payload, now_us, 0)
        north.handover.receive("south", payload[:-1], now_us, 0)
        north.handover.receive("south", payload, now_us + 11_000_000, 0)
        forged.handover.receive("north", payload, now_us, 0)
    assert north.handover.results == {"unknown_origin": 1, "damaged": 1, "late": 1}
    assert forged.handover.results == {"damaged": 3}


def test_a_state_that_is_repeated_later_is_not_taken_up() -> None:
    platoon, south, north = Platoon(1), Site("south", "north", NORTH), Site("north", "south", SOUTH)
    for _ in range(59):
        south.step(platoon.next())
    handed = [south.step(platoon.next())[0] for _ in range(5)]
    (_, _, payload), *_ = [state for of in handed for state in of.states]
    platoon.k += 40
    north.handover.receive("south", payload, platoon.t_us, 0)
    records = replace(platoon.next(), received_us=np.array([platoon.t_us]))
    north.step(records)
    assert north.handover.results["late"] == 1
    assert north.handover.results["adopted"] == 0


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ('secret = "too short"\n[neighbours]\n', "secret: String should have at least 16 characters"),
        ('secret = "of sixteen letters"\n', "neighbours: Field required"),
        ("secret = of sixteen letters\n", "Invalid value (at line 1, column 10)"),
    ],
)
def test_a_wrong_file_is_one_line_without_the_secret(content: str, problem: str, tmp_path: Path) -> None:
    file = tmp_path / "neighbours.toml"
    file.write_text(content)
    with pytest.raises(UserError) as refused:
        read_config(file)
    assert str(refused.value) == f"handover {file}: {problem}"
