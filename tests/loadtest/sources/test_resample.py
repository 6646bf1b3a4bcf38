import numpy as np
import pytest

from headway_loadtest.sources.resample import smooth_path
from headway_loadtest.sources.road import Road

METRES_PER_DEGREE = 111_000.0


def drive(seconds=60.0):
    t_s = np.arange(0.0, seconds, 0.1)
    speed_mps = 15.0 + 5.0 * np.sin(t_s / 7.0)
    x_m = np.concatenate([[0.0], np.cumsum(0.05 * (speed_mps[1:] + speed_mps[:-1]))])
    return t_s, x_m, speed_mps, *Road.winding(42.3, -83.7, 0.0, 2000.0).at(x_m)


def test_the_rounding_of_the_file_is_gone():
    t_s, _, speed_mps, lat, lon, heading_deg = drive()
    rounded_lat, rounded_lon = np.round(lat, 5), np.round(lon, 5)
    _, steady_lat, steady_lon = smooth_path(t_s, rounded_lat, rounded_lon, speed_mps, heading_deg)
    assert np.std(rounded_lat - lat) * METRES_PER_DEGREE > 0.25
    assert np.std(steady_lat - lat) * METRES_PER_DEGREE < 0.1
    steps_m = np.hypot(np.diff(steady_lat), np.diff(steady_lon) * np.cos(np.radians(42.3))) * METRES_PER_DEGREE
    assert np.std(steps_m - np.diff(t_s) * speed_mps[1:]) < 0.06


def test_distance_is_the_integral_of_speed():
    t_s, x_m, speed_mps, lat, lon, heading_deg = drive()
    found_m, _, _ = smooth_path(t_s, lat, lon, speed_mps, heading_deg)
    assert np.allclose(found_m, x_m)


def test_a_silence_cuts_the_path_but_not_the_distance():
    t_s, x_m, speed_mps, lat, lon, heading_deg = drive()
    kept = (t_s < 20.0) | (t_s > 30.0)
    found_m, found_lat, _ = smooth_path(*(column[kept] for column in (t_s, lat, lon, speed_mps, heading_deg)))
    assert found_m[-1] == pytest.approx(x_m[-1], abs=1.0)
    assert np.abs(found_lat - lat[kept]).max() * METRES_PER_DEGREE < 0.1


def test_one_and_two_readings_stay_as_they_are():
    for n in (1, 2):
        column = np.arange(n) / 10
        x_m, lat, lon = smooth_path(column, 42.0 + column / 1e5, -83.0 + column, np.ones(n), np.zeros(n))
        assert len(x_m) == n
        assert np.allclose(lat, 42.0 + column / 1e5)
        assert np.allclose(lon, -83.0 + column)
