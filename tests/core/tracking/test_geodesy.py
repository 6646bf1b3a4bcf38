import math

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from headway.core.tracking.geodesy import displaced_deg, displacement_m, metres_per_degree


def geodesic(lat: float, lon: float, azimuth: float, distance_m: float) -> tuple[float, float, float, float]:
    """Exact end point, and (east, north) in the direction that the geodesic has halfway."""
    there = Geodesic.WGS84.Direct(lat, lon, azimuth, distance_m)
    halfway = math.radians(Geodesic.WGS84.Direct(lat, lon, azimuth, distance_m / 2)["azi2"])
    return there["lat2"], there["lon2"], distance_m * math.sin(halfway), distance_m * math.cos(halfway)


@pytest.mark.parametrize(("lat_max", "bound_m"), [(75.0, 1e-6), (89.7, 1e-3)])
def test_displacement_agrees_with_the_geodesic_at_150_m(lat_max: float, bound_m: float) -> None:
    rng = np.random.default_rng(1)
    worst_m = 0.0
    for lat in np.append(rng.uniform(-lat_max, lat_max, 300), [0.0, lat_max, -lat_max]):
        lon, azimuth = rng.uniform(-180.0, 180.0, 2)
        lat2, lon2, east, north = geodesic(lat, lon, azimuth, 150.0)
        got_east, got_north = displacement_m(lat, lon, lat2, lon2)
        worst_m = max(worst_m, math.hypot(got_east - east, got_north - north))
    assert worst_m < bound_m


def test_a_degree_at_the_equator_and_at_the_pole() -> None:
    """a pi / 180 round the equator; M = a (1 - e^2) there, and M = a / sqrt(1 - e^2) at a pole."""
    a, e2 = Geodesic.WGS84.a, Geodesic.WGS84.f * (2 - Geodesic.WGS84.f)
    east, north = metres_per_degree(0.0)
    assert east == pytest.approx(math.radians(a), rel=1e-12)
    assert north == pytest.approx(math.radians(a * (1 - e2)), rel=1e-12)
    assert metres_per_degree(90.0)[1] == pytest.approx(math.radians(a / math.sqrt(1 - e2)), rel=1e-12)


def test_displacement_is_antisymmetric() -> None:
    there = displacement_m(48.0, 11.0, 48.001, 11.002)
    back = displacement_m(48.001, 11.002, 48.0, 11.0)
    assert (-back[0], -back[1]) == there


@pytest.mark.parametrize(("lon", "other"), [(179.9999, -179.9999), (-179.9999, 179.9999), (180.0, -180.0)])
def test_the_antimeridian_is_no_wall(lon: float, other: float) -> None:
    east, north = displacement_m(10.0, lon, 10.0, other)
    assert abs(east) == pytest.approx(abs(Geodesic.WGS84.Inverse(10.0, lon, 10.0, other)["s12"]), abs=1e-6)
    assert math.copysign(1.0, east) == math.copysign(1.0, lon) or east == 0.0
    assert north == 0.0


@pytest.mark.parametrize("lat", [90.0, -90.0, 89.999999])
def test_poles_are_finite(lat: float) -> None:
    assert np.isfinite(displacement_m(lat, 0.0, lat, 180.0)).all()
    there = displaced_deg(lat, 170.0, 3.0, -3.0)
    assert np.isfinite(there).all()
    assert -180.0 <= there[1] <= 180.0


@pytest.mark.parametrize(("lat", "lon"), [(48.1, 11.5), (-33.9, 151.2), (0.0, 180.0), (69.6, -179.99999)])
def test_displaced_is_the_inverse(lat: float, lon: float) -> None:
    there = displaced_deg(lat, lon, 2.5, -1.7)
    assert displacement_m(lat, lon, *there) == pytest.approx((2.5, -1.7), abs=1e-5)
