"""Metres between two nearby positions on the WGS84 ellipsoid.

The displacement is taken in the plane that touches the ellipsoid halfway between the two points: the meridian radius
M and the prime-vertical radius N at the mean latitude turn degrees into metres (Torge and Mueller, Geodesy, 2012,
sec. 4.1). Against the exact geodesic the error grows with distance^3 tan^2(latitude): at 150 m less than 1 micrometre
up to 75 degrees of latitude and 1 mm up to 89.7. At the poles the result is finite and no more is promised.
"""

import math

from numba import njit

SEMI_MAJOR_M = 6_378_137.0
FLATTENING = 1.0 / 298.257223563
ECCENTRICITY_SQUARED = FLATTENING * (2.0 - FLATTENING)

_COS_MIN = 1e-9  # keeps a step to the east finite at a pole


@njit(cache=True, error_model="numpy")
def metres_per_degree(lat_deg: float) -> tuple[float, float]:
    """Return the length of one degree of longitude and of one degree of latitude, m."""
    cos_lat = math.cos(math.radians(lat_deg))
    w_squared = 1.0 - ECCENTRICITY_SQUARED * (1.0 - cos_lat * cos_lat)
    prime_vertical_m = SEMI_MAJOR_M / math.sqrt(w_squared)
    meridian_m = prime_vertical_m * (1.0 - ECCENTRICITY_SQUARED) / w_squared
    return math.radians(prime_vertical_m * max(cos_lat, _COS_MIN)), math.radians(meridian_m)


@njit(cache=True, error_model="numpy")
def wrap_degrees(angle_deg: float) -> float:
    """Return the same angle within -180..180."""
    return angle_deg - 360.0 * math.floor(angle_deg / 360.0 + 0.5)


@njit(cache=True, error_model="numpy")
def displacement_m(from_lat_deg: float, from_lon_deg: float, lat_deg: float, lon_deg: float) -> tuple[float, float]:
    """Return (east_m, north_m) from the first position to the second, the short way round the antimeridian."""
    east_per_degree, north_per_degree = metres_per_degree(0.5 * (from_lat_deg + lat_deg))
    return wrap_degrees(lon_deg - from_lon_deg) * east_per_degree, (lat_deg - from_lat_deg) * north_per_degree


@njit(cache=True, error_model="numpy")
def displaced_deg(lat_deg: float, lon_deg: float, east_m: float, north_m: float) -> tuple[float, float]:
    """Return (lat_deg, lon_deg) that far from a position: the inverse of `displacement_m`, for some metres."""
    east_per_degree, north_per_degree = metres_per_degree(lat_deg)
    return lat_deg + north_m / north_per_degree, wrap_degrees(lon_deg + east_m / east_per_degree)
