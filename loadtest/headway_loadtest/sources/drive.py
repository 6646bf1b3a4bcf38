"""Drives: the true readings of vehicles, sample by sample, before faults are injected."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
I64 = NDArray[np.int64]


class SourceError(ValueError):
    """A source that cannot be read: one line that names the file, the row where there is one, and the problem."""


@dataclass(frozen=True, slots=True)
class Ahead:
    """The vehicle ahead as the sender's own forward sensor sees it. `which` is (n,), -1 where there is none.

    `ids[which]` is its identifier, `range_m` and `range_rate_mps` are NaN where `which` is -1.
    """

    ids: tuple[str, ...]
    which: I64
    range_m: F64
    range_rate_mps: F64


@dataclass(frozen=True, slots=True, kw_only=True)
class Drive:
    """One vehicle's readings. Shapes (n,): one entry per sample, `t_s` increasing from the start of its scene.

    `x_m` is the distance along the vehicle's own path; position (WGS84) and heading (clockwise from north) are
    degrees, NaN for a heading that is not known. Vehicles that meet each other share a scene.
    """

    vehicle: str
    t_s: F64
    x_m: F64
    speed_mps: F64
    lat: F64
    lon: F64
    heading_deg: F64
    length_m: float | None = None
    ahead: Ahead | None = None


Scene = tuple[Drive, ...]
