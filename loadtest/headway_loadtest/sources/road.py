"""Roads: where a distance along the road lies on the earth (WGS84)."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]

SEMI_MAJOR_M = 6_378_137.0
ECCENTRICITY_2 = 6.69437999014e-3
KNOT_M = 1.0
DRIVEN_KNOT_M = 0.5


def radii_m(lat_deg: F64 | float) -> tuple[F64, F64]:
    """Radii of curvature of the WGS84 ellipsoid: along the meridian (M), and across it (N)."""
    w2 = 1.0 - ECCENTRICITY_2 * np.square(np.sin(np.radians(lat_deg)))
    return SEMI_MAJOR_M * (1.0 - ECCENTRICITY_2) / w2**1.5, SEMI_MAJOR_M / np.sqrt(w2)


def displace(lat: F64, lon: F64, heading_deg: F64, ahead_m: F64 | float, right_m: F64 | float = 0.0) -> tuple[F64, F64]:
    """Move points over a short distance (to within 2 mm up to 100 m) ahead and to the right of their heading.

    Headings are in degrees clockwise from north; every array is (n,); returns latitude and longitude, degrees.
    """
    sin, cos = np.sin(np.radians(heading_deg)), np.cos(np.radians(heading_deg))
    meridian_m, normal_m = radii_m(lat)
    north_m = ahead_m * cos - right_m * sin
    east_m = ahead_m * sin + right_m * cos
    return (
        lat + np.degrees(north_m / meridian_m),
        lon + np.degrees(east_m / (normal_m * np.cos(np.radians(lat)))),
    )


@dataclass(frozen=True, slots=True)
class Road:
    """A line on the earth, by knots: distance along it (increasing), position, and heading without jumps at north.

    Beyond its ends it goes straight on.
    """

    x_m: F64
    lat: F64
    lon: F64
    heading_rad: F64

    @classmethod
    def winding(
        cls, lat: float, lon: float, from_m: float, to_m: float, *, heading_deg: float = 45.0, swing_deg: float = 20.0
    ) -> Self:
        """Lay a road that swings to and fro around a heading, one swing in 2 km, from a point on the earth.

        Its tightest curve has a radius of 2 km / (2 pi swing in radians), 912 m for 20 degrees. Knots are a metre
        apart, so the polyline lies within a millimetre of the curve.
        """
        x_m = np.arange(from_m, to_m + KNOT_M, KNOT_M)
        middle_m = x_m - KNOT_M / 2
        swing = 2 * np.pi / 2000.0
        heading = np.radians(heading_deg) + np.radians(swing_deg) * np.sin(swing * (x_m - from_m))
        between = np.radians(heading_deg) + np.radians(swing_deg) * np.sin(swing * (middle_m - from_m))
        north_m = KNOT_M * np.cos(between)
        east_m = KNOT_M * np.sin(between)
        north_m[0] = east_m[0] = 0.0
        lats = lat + np.degrees(np.cumsum(north_m) / radii_m(lat)[0])
        lats = lat + np.degrees(np.cumsum(north_m / radii_m(lats)[0]))
        lons = lon + np.degrees(np.cumsum(east_m / (radii_m(lats)[1] * np.cos(np.radians(lats)))))
        return cls(x_m, lats, lons, heading)

    @classmethod
    def driven(cls, x_m: F64, lat: F64, lon: F64, heading_deg: F64) -> Self:
        """Road under a vehicle's own path: knots wherever it had moved on by half a metre."""
        moved = np.concatenate([[True], np.diff(np.floor(x_m / DRIVEN_KNOT_M)) > 0])
        return cls(x_m[moved], lat[moved], lon[moved], np.unwrap(np.radians(heading_deg[moved])))

    def at(self, x_m: F64) -> tuple[F64, F64, F64]:
        """Latitude, longitude and heading (degrees, 0 to 360) at distances along the road, (n,) each."""
        lat = np.interp(x_m, self.x_m, self.lat)
        lon = np.interp(x_m, self.x_m, self.lon)
        heading_deg = np.degrees(np.interp(x_m, self.x_m, self.heading_rad)) % 360.0
        beyond_m = x_m - np.clip(x_m, self.x_m[0], self.x_m[-1])
        lat, lon = displace(lat, lon, heading_deg, beyond_m)
        return lat, lon, heading_deg
