"""A recorded path without the rounding of its file.

The public SPMD files print positions with seven digits: a longitude in Michigan moves in steps of 0.6 to 0.8 m, while
the receiver that broadcast it knew 0.008 m from one reading to the next. Dead reckoning (speed along heading) has no
such steps but wanders off; the difference of the two, averaged over a few seconds, is added back to it.
"""

from itertools import pairwise

import numpy as np

from headway_loadtest.sources.drive import F64
from headway_loadtest.sources.road import radii_m

WINDOW_S = 4.0
GAP_S = 1.0


def smooth_path(t_s: F64, lat: F64, lon: F64, speed_mps: F64, heading_deg: F64) -> tuple[F64, F64, F64]:
    """Distance travelled (m), latitude and longitude of one vehicle's path; every array is (n,).

    Gaps longer than a second cut the path: each part is smoothed by itself, and the distance between parts is the
    straight line.
    """
    north_m = np.radians(lat - lat[0]) * radii_m(lat[0])[0]
    east_per_deg = np.radians(1.0) * radii_m(lat[0])[1] * np.cos(np.radians(lat[0]))
    east_m = (lon - lon[0]) * east_per_deg
    heading = np.radians(heading_deg)
    bounds = [0, *(np.flatnonzero(np.diff(t_s) > GAP_S) + 1).tolist(), len(t_s)]
    for start, stop in pairwise(bounds):
        part = slice(start, stop)
        for place_m, velocity_mps in (
            (north_m, speed_mps * np.cos(heading)),
            (east_m, speed_mps * np.sin(heading)),
        ):
            reckoned_m = _integral(t_s[part], velocity_mps[part])
            place_m[part] = reckoned_m + _average(place_m[part] - reckoned_m, t_s[part])
    step_m = np.where(
        np.diff(t_s) > GAP_S,
        np.hypot(np.diff(north_m), np.diff(east_m)),
        np.diff(t_s) * (speed_mps[1:] + speed_mps[:-1]) / 2,
    )
    x_m = np.concatenate([[0.0], np.cumsum(step_m)])
    return x_m, lat[0] + np.degrees(north_m / radii_m(lat[0])[0]), lon[0] + east_m / east_per_deg


def _integral(t_s: F64, velocity_mps: F64) -> F64:
    return np.concatenate([[0.0], np.cumsum(np.diff(t_s) * (velocity_mps[1:] + velocity_mps[:-1]) / 2)])


def _average(residual_m: F64, t_s: F64) -> F64:
    """Centred Hann-weighted average; near the ends over the samples that exist."""
    n = len(t_s)
    if n < 3:
        return residual_m
    half = max(1, round(WINDOW_S / 2 / float(np.median(np.diff(t_s)))))
    weights = np.hanning(2 * half + 3)[1:-1]
    middle = slice(half, half + n)
    averaged: F64 = np.convolve(residual_m, weights)[middle] / np.convolve(np.ones(n), weights)[middle]
    return averaged
