"""Metres on a plane as places on the earth, for recordings with local coordinates."""

import math
from typing import Final, NamedTuple

_SEMI_MAJOR_M: Final = 6_378_137.0
_ECCENTRICITY_2: Final = 6.69437999014e-3
"""WGS 84."""
_STANDSTILL_MPS: Final = 1e-3


class Origin(NamedTuple):
    """The place with the coordinates 0, 0."""

    lat: float
    lon: float

    def lat_lon(self, east_m: float, north_m: float) -> tuple[float, float]:
        """Return the latitude and longitude of a point; distances are right to 1e-4 within 50 km."""
        w2 = 1.0 - _ECCENTRICITY_2 * math.sin(math.radians(self.lat)) ** 2
        meridian_m = _SEMI_MAJOR_M * (1.0 - _ECCENTRICITY_2) / w2**1.5
        lat = self.lat + math.degrees(north_m / meridian_m)
        normal_m = _SEMI_MAJOR_M / math.sqrt(1.0 - _ECCENTRICITY_2 * math.sin(math.radians(lat)) ** 2)
        lon = self.lon + math.degrees(east_m / (normal_m * math.cos(math.radians(lat))))
        return lat, (lon + 180.0) % 360.0 - 180.0


ORIGIN: Final = Origin(48.0, 11.0)
"""Of recordings that do not say where they were made."""


def course_deg(east_mps: float, north_mps: float) -> float | None:
    """Return the course of a velocity in degrees clockwise from north; None at standstill."""
    if math.hypot(east_mps, north_mps) < _STANDSTILL_MPS:
        return None
    return math.degrees(math.atan2(east_mps, north_mps)) % 360.0
