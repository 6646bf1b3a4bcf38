import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from headway_loadtest.sources.road import Road, displace


def distance_m(lat1, lon1, lat2, lon2):
    return Geodesic.WGS84.Inverse(lat1, lon1, lat2, lon2)["s12"]


@pytest.mark.parametrize("lat", [-33.0, 0.0, 42.3, 65.0])
@pytest.mark.parametrize("heading_deg", [0.0, 45.0, 137.0, 270.0])
def test_displace_agrees_with_the_geodesic(lat, heading_deg):
    there = displace(np.array([lat]), np.array([12.0]), np.array([heading_deg]), 80.0)
    direct = Geodesic.WGS84.Direct(lat, 12.0, heading_deg, 80.0)
    assert distance_m(there[0][0], there[1][0], direct["lat2"], direct["lon2"]) < 2e-3


def test_right_is_to_the_right():
    lat, lon = displace(np.array([50.0]), np.array([8.0]), np.array([0.0]), 0.0, 10.0)
    assert lat[0] == pytest.approx(50.0, abs=1e-9)
    assert distance_m(50.0, 8.0, lat[0], lon[0]) == pytest.approx(10.0, abs=1e-4)
    assert lon[0] > 8.0


def test_a_metre_of_winding_road_is_a_metre_on_earth():
    road = Road.winding(42.3, -83.7, 0.0, 20_000.0)
    x_m = np.linspace(0.0, 20_000.0, 801)
    lat, lon, _ = road.at(x_m)
    steps_m = [distance_m(*ends) for ends in zip(lat[:-1], lon[:-1], lat[1:], lon[1:], strict=True)]
    chord = 25.0 * (1 - 25.0**2 / (24 * 912.0**2))
    assert min(steps_m) > chord - 1e-3
    assert max(steps_m) < 25.0 + 1e-3


def test_heading_is_the_direction_of_travel():
    road = Road.winding(42.3, -83.7, 100.0, 3000.0, heading_deg=350.0, swing_deg=25.0)
    x_m = np.linspace(110.0, 2900.0, 50)
    lat, lon, heading_deg = road.at(x_m)
    ahead_lat, ahead_lon, _ = road.at(x_m + 1.0)
    for here, heading in zip(zip(lat, lon, ahead_lat, ahead_lon, strict=True), heading_deg, strict=True):
        bearing = Geodesic.WGS84.Inverse(*here)["azi1"]
        assert (bearing - heading + 180) % 360 - 180 == pytest.approx(0.0, abs=0.1)
    assert np.all((heading_deg >= 0) & (heading_deg < 360))


def test_beyond_its_ends_a_road_goes_straight_on():
    road = Road.winding(42.3, -83.7, 0.0, 500.0)
    lat, lon, heading_deg = road.at(np.array([-50.0, 0.0, 500.0, 560.0]))
    assert distance_m(lat[0], lon[0], lat[1], lon[1]) == pytest.approx(50.0, abs=1e-3)
    assert distance_m(lat[2], lon[2], lat[3], lon[3]) == pytest.approx(60.0, abs=1e-3)
    assert heading_deg[2] == heading_deg[3]


def test_a_driven_road_leads_along_the_path_and_ignores_standing_still():
    truth = Road.winding(42.3, -83.7, 0.0, 400.0)
    x_m = np.concatenate([np.linspace(0.0, 200.0, 101), np.full(50, 200.0), np.linspace(200.0, 400.0, 101)])
    road = Road.driven(x_m, *truth.at(x_m))
    wanted = np.array([50.3, 199.9, 200.4, 333.3])
    for found, there in zip(road.at(wanted), truth.at(wanted), strict=True):
        assert np.allclose(found, there, atol=2e-2)
    assert np.all(np.diff(road.x_m) > 0)
