"""Errors of satellite receivers: correlated position and speed on top of true readings."""

from dataclasses import dataclass

import numpy as np

from headway_loadtest.evaluate.field.recordings import Records
from headway_loadtest.sources.drive import F64
from headway_loadtest.sources.road import displace

POSITION_TAU_S = 30.0
"""Correlation time of a position error: ephemeris, atmosphere and multipath change this slowly."""
SPEED_TAU_S = 0.2
"""Correlation time of Doppler speed, .1 to .3 s on 10 Hz receivers."""
WHITE_SHARE = 0.1
"""White part of the position error; of 0.3 to 0.5 m it makes steps 0.04 to 0.07 m wrong, as receivers at 10 Hz have."""
HEADING_LEAST_MPS = 1.0
"""Heading is the direction of the velocity, so its error grows as speed falls, down to this speed."""

ACCEL_MPS2 = 0.2
"""White error of an acceleration, as low-cost inertial sensors have on a road."""


@dataclass(frozen=True, slots=True)
class GnssError:
    """Standard deviations of the position, in each direction, and of the speed."""

    position_m: float
    speed_mps: float


def ornstein_uhlenbeck(rng: np.random.Generator, t_s: F64, std: float, tau_s: float) -> F64:
    """Return a stationary process with correlation exp(-|dt| / tau) at times (n,)."""
    keep = np.exp(-np.diff(t_s) / tau_s)
    kicks = std * np.sqrt(1.0 - keep**2) * rng.standard_normal(keep.size)
    value = std * float(rng.standard_normal())
    values = [value]
    for part, kick in zip(keep.tolist(), kicks.tolist(), strict=True):
        value = part * value + kick
        values.append(value)
    return np.array(values)


def shift(track: Records, north_m: F64 | float, east_m: F64 | float) -> None:
    """Displace positions to the north and to the east, in place."""
    north = np.zeros(len(track))
    track["lat_deg"], track["lon_deg"] = displace(track["lat_deg"], track["lon_deg"], north, north_m, east_m)


def walk(rng: np.random.Generator, track: Records, std_m: float, tau_s: float) -> None:
    """Let positions wander in both directions, in place."""
    t_s = track["t_us"] / 1e6
    shift(track, *(ornstein_uhlenbeck(rng, t_s, std_m, tau_s) for _ in range(2)))


def add_gnss_error(rng: np.random.Generator, track: Records, error: GnssError) -> None:
    """Put a receiver's error on the true readings of one vehicle, in place, and declare its accuracy."""
    n = len(track)
    t_s, speed = track["t_us"] / 1e6, track["speed_mps"].copy()
    walk(rng, track, error.position_m, POSITION_TAU_S)
    white_m = WHITE_SHARE * error.position_m
    shift(track, rng.normal(0.0, white_m, n), rng.normal(0.0, white_m, n))
    along, across = (ornstein_uhlenbeck(rng, t_s, error.speed_mps, SPEED_TAU_S) for _ in range(2))
    track["speed_mps"] = np.maximum(speed + along, 0.0)
    off_deg = np.degrees(across / np.maximum(speed, HEADING_LEAST_MPS))
    track["heading_deg"] = (track["heading_deg"] + off_deg) % 360.0
    track["accel_mps2"] += rng.normal(0.0, ACCEL_MPS2, n)
    track["accuracy_m"] = error.position_m
