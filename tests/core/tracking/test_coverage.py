import numpy as np

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
