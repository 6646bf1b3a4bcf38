"""The index in crowds, between two builds, and at the antimeridian."""

import numpy as np
import pytest
from core.roads import START_US, STEP_S, STRAIGHT, Car, World, drive

from headway.core.tracking.pairing import NO_LEADER
from headway.core.tracking.spatial_index import NEAREST, find_near
from headway.core.tracking.tracks import DEFAULT_LENGTH_M

LANE_M = 3.6


def test_ten_thousand_vehicles_at_one_spot_are_a_bounded_crowd() -> None:
    """A search returns at most NEAREST vehicles, the nearest first; no vehicle leads itself."""
    n = 10_000
    world = World(capacity=n)
    rows = np.arange(n)
    rng = np.random.default_rng(1)
    for k in range(12):
        t_us = START_US + round(k * STEP_S * 1e6)
        lat, lon = 48.0 + rng.normal(0.0, 1e-5, n), 11.0 + rng.normal(0.0, 1e-5, n)
        world.advance(rows, t_us, lat, lon, rng.uniform(0.0, 40.0, n), rng.uniform(0.0, 360.0, n))
        world.extend_path_history(rows, np.ones(n, np.bool_), np.zeros(n))
        world.find_leaders(rows, t_us)
    nearby, apart_squared = np.empty(NEAREST, np.int64), np.empty(NEAREST)
    for row in range(0, n, 1000):
        count = find_near(world.grid, world.tracks[row], row, world.range_m, nearby, apart_squared)
        assert 0 < count <= NEAREST
        assert row not in nearby[:count]
        assert len(set(nearby[:count])) == count
        assert (np.diff(apart_squared[:count]) >= 0.0).all()
    assert all(leader != row for row, leader in enumerate(world.leaders()))


def test_between_two_builds_of_the_index_vehicles_are_extrapolated() -> None:
    """At 45 m/s the one 8 m ahead was behind here a fifth of a second ago."""
    world = World(capacity=2)
    cars = [Car(STRAIGHT, lambda t: 45.0 * t), Car(STRAIGHT, lambda t: 8.0 + 45.0 * t)]
    drive(world, cars, STEP_S)
    built_us = int(world.grid.built_us[0])
    drive(world, cars, 2 * STEP_S, start_s=STEP_S)
    assert world.grid.built_us[0] == built_us
    nearby, apart_squared = np.empty(NEAREST, np.int64), np.empty(NEAREST)
    assert find_near(world.grid, world.tracks[0], 0, 150.0, nearby, apart_squared) == 1
    assert nearby[0] == 1


def test_a_dense_jam_still_finds_the_one_ahead() -> None:
    """Six lanes bumper to bumper, 40 cars each: more candidates within range than a search returns."""
    n = 240
    world = World(capacity=n)
    rows = np.arange(n)
    lane, place = rows // 40, rows % 40
    for k in range(30):
        north = place * 7.5 + k * 0.2
        lat = 48.0 + north / 111_200.0
        lon = 11.0 + lane * LANE_M / 74_600.0
        t_us = START_US + round(k * STEP_S * 1e6)
        world.advance(rows, t_us, lat, lon, np.full(n, 2.0), np.zeros(n))
        world.extend_path_history(rows, np.ones(n, np.bool_), np.full(n, 2.0))
        world.find_leaders(rows, t_us)
    assert world.leaders() == [row + 1 if row % 40 < 39 else NO_LEADER for row in range(n)]


@pytest.mark.parametrize("origin_lon", [179.9999, 179.99999, 179.9985])
def test_across_the_antimeridian(origin_lon: float) -> None:
    world = World(capacity=2)
    rows = np.arange(2)
    for k in range(60):
        lon = origin_lon + (np.array([0.0, 30.0]) + k * 0.5) / 111_319.0
        lon = (lon + 180.0) % 360.0 - 180.0
        t_us = START_US + round(k * STEP_S * 1e6)
        world.advance(rows, t_us, np.zeros(2), lon, np.full(2, 5.0), np.full(2, 90.0))
        world.extend_path_history(rows, np.ones(2, np.bool_), np.full(2, 5.0))
        world.find_leaders(rows, t_us)
        if k >= 20:
            assert world.leaders() == [1, NO_LEADER]
            assert world.gap_m(0) == pytest.approx(30.0 - DEFAULT_LENGTH_M, abs=0.01)
