import numpy as np
import pytest

from headway.core.tracking import coverage, tracks

METRE_DEG = 1.0 / 111_083.0  # of latitude at 42 degrees north


def vehicle(x_m, v_mps=15.0):
    """A track of a car that drives north, `x_m` from a fixed place."""
    [made] = tracks.new_tracks(1)
    made["lat_deg"], made["lon_deg"] = 42.0 + x_m * METRE_DEG, -83.0
    made["v_mps"], made["heading_north"] = v_mps, 1.0
    return made


def drive(cells, to_m):
    """One car drives along the road up to a place."""
    car = vehicle(0.0)
    for x_m in np.arange(0.0, to_m, 1.5):
        car["lat_deg"] = 42.0 + x_m * METRE_DEG
        coverage.enter_cell(cells, car)


def test_the_road_ahead_is_covered_where_several_cars_were_received():
    cells = coverage.new_coverage()
    drive(cells, 600.0)
    assert not coverage.is_covered_beyond(cells, vehicle(300.0), 1.0)
    for _ in range(3):
        drive(cells, 600.0)
    assert coverage.is_covered_beyond(cells, vehicle(300.0), 1.0)


def test_it_is_not_covered_at_the_edge():
    cells = coverage.new_coverage()
    for _ in range(10):
        drive(cells, 250.0)
    assert coverage.is_covered_beyond(cells, vehicle(100.0), 1.0)
    assert not coverage.is_covered_beyond(cells, vehicle(245.0), 1.0)
    assert not coverage.is_covered_beyond(cells, vehicle(100.0), 20.0)


def test_a_car_that_waits_in_a_cell_counts_once():
    cells, car = coverage.new_coverage(), vehicle(100.0, v_mps=0.0)
    for _ in range(100):
        coverage.enter_cell(cells, car)
    assert cells["entries"].max() == 1


def observed_road(cars, to_m=1000.0):
    """Cells of a road on which cars begin at its start."""
    cells = coverage.new_coverage()
    for _ in range(cars):
        drive(cells, to_m)
    return cells


def beginner(cells, x_m, v_mps=15.0):
    """Two tracks: the second is first received there, the first is another vehicle, sending far away."""
    made = tracks.new_tracks(2)
    made["lat_deg"], made["lon_deg"] = [42.0 + 5000.0 * METRE_DEG, 42.0 + x_m * METRE_DEG], -83.0
    made["v_mps"], made["heading_north"], made["t_us"] = v_mps, 1.0, 100_000_000
    coverage.enter_cell(cells, made[1])
    return made


def appears(made, receiving_since_us=0):
    """Whether the second stands as one that appeared, three seconds later."""
    made["t_us"] += np.where(made["cell_key"] > 0, 3_000_000, 0)
    coverage.judge_appearance(made, 1, 103_000_000, receiving_since_us)
    return coverage.is_appearing(made[1])


def still_sending(made):
    made["t_us"][0] = 103_000_000
    return made


@pytest.mark.parametrize(("cars", "x_m", "v_mps", "sudden"), [
    (40, 500.0, 15.0, True),
    (40, 50.0, 15.0, False),
    (40, 500.0, 2.0, False),
    (10, 500.0, 15.0, False),
    (40, 1500.0, 15.0, False),
])  # fmt: skip
def test_a_vehicle_that_begins_in_motion_inside_observed_road_appears(cars, x_m, v_mps, sudden):
    assert appears(still_sending(beginner(observed_road(cars), x_m, v_mps))) == sudden


def test_a_vehicle_that_fell_silent_within_reach_explains_it():
    made = beginner(observed_road(40), 500.0)
    made["lat_deg"][0], made["t_us"][0] = 42.0 + 400.0 * METRE_DEG, 93_000_000
    assert not appears(made)


def test_a_service_that_did_not_receive_explains_it():
    assert not appears(still_sending(beginner(observed_road(40), 500.0)), receiving_since_us=90_000_000)


def test_an_appearance_is_told_for_five_seconds():
    made = still_sending(beginner(observed_road(40), 500.0))
    assert appears(made)
    made["t_us"][1] += 5_000_000
    assert not coverage.is_appearing(made[1])
