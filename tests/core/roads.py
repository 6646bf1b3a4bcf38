"""Roads and cars for the tests of tracks and pairing: true paths on the ellipsoid, by geographiclib."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from geographiclib.geodesic import Geodesic
from numpy.typing import NDArray

from headway.core.tracking.pairing import NO_LEADER, find_leaders, gaps_m, leader_of, new_pairing
from headway.core.tracking.spatial_index import new_grid
from headway.core.tracking.tracks import advance, extend_path_history, new_tracks
from headway.core.types.batch import F64, I64, Columns
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records

START_US = 1_700_000_000_000_000
STEP_S = 0.1
ORIGIN = (48.14, 11.56)

Reading = tuple[float, float, float, float]
"""Latitude, longitude, speed, heading in degrees."""

Spoil = Callable[[int, float, Reading], Reading]
"""What a receiver makes of the true reading of a row at a time in seconds."""

Motion = Callable[[float], float]
"""A quantity of a car, given the seconds since the start."""


def lat_lon(east_m: float, north_m: float, origin: tuple[float, float] = ORIGIN) -> tuple[float, float]:
    """Return the position that far from the origin; distances within the scene are true to 1e-8."""
    place = Geodesic.WGS84.Direct(*origin, math.degrees(math.atan2(east_m, north_m)), math.hypot(east_m, north_m))
    return place["lat2"], place["lon2"]


@dataclass(frozen=True)
class Road:
    """A centre line of straights and arcs: (length_m, curvature) each, curvature positive to the left."""

    pieces: tuple[tuple[float, float], ...]
    heading_rad: float = 0.0
    east_m: float = 0.0
    north_m: float = 0.0

    def place(self, s_m: float, left_m: float = 0.0) -> tuple[float, float, float]:
        """Return east, north and heading (clockwise from north) at s along the line; the last piece has no end."""
        east, north, heading = self.east_m, self.north_m, self.heading_rad
        for i, (length, curvature) in enumerate(self.pieces):
            run = s_m if i == len(self.pieces) - 1 or s_m < length else length
            after = heading - curvature * run
            if curvature == 0.0:
                east += run * math.sin(heading)
                north += run * math.cos(heading)
            else:
                east += (math.cos(after) - math.cos(heading)) / curvature
                north += (math.sin(heading) - math.sin(after)) / curvature
            heading = after
            s_m -= run
            if s_m <= 0.0:
                break
        return east - left_m * math.cos(heading), north + left_m * math.sin(heading), heading


STRAIGHT = Road(((1e6, 0.0),))


@dataclass(frozen=True)
class Car:
    """One car on one road; its receiver adds what is given here to where it truly is."""

    road: Road
    s_m: Motion
    left_m: Motion = lambda _: 0.0
    offset_m: tuple[float, float] = (0.0, 0.0)
    declares_heading: bool = True

    def reading(self, t_s: float) -> Reading:
        """Return lat, lon, speed, heading in degrees."""
        h = 1e-3
        east, north, _ = self.road.place(self.s_m(t_s), self.left_m(t_s))
        before = self.road.place(self.s_m(t_s - h), self.left_m(t_s - h))
        after = self.road.place(self.s_m(t_s + h), self.left_m(t_s + h))
        de, dn = after[0] - before[0], after[1] - before[1]
        speed = math.hypot(de, dn) / (2 * h)
        heading = math.atan2(de, dn) if speed > 1e-6 else self.road.place(self.s_m(t_s))[2]
        lat, lon = lat_lon(east + self.offset_m[0], north + self.offset_m[1])
        return lat, lon, speed, math.degrees(heading) % 360.0 if self.declares_heading else math.nan


def columns_of(
    t_us: I64, msg_cnt: I64, lat_deg: F64, lon_deg: F64, speed_mps: F64, heading_deg: F64, accuracy_m: F64
) -> Columns:
    """Return the columns of records received at once, of unknown length and without a forward sensor."""
    unknown = np.full(t_us.size, np.nan)
    return Columns(t_us, t_us, msg_cnt, lat_deg, lon_deg, speed_mps, heading_deg, accuracy_m, *[unknown] * 3)


@dataclass
class World:
    """Tracks and pairing as the engine drives them; row i is car i."""

    capacity: int = 16
    lane_width_m: float = 3.6
    range_m: float = 150.0
    tracks: Records = field(init=False)
    pairing: Records = field(init=False)

    def __post_init__(self) -> None:
        self.tracks = new_tracks(self.capacity)
        self.pairing = new_pairing(self.capacity)
        self.grid = new_grid(self.capacity)

    def advance(
        self,
        rows: I64,
        t_us: int | I64,
        lat: F64,
        lon: F64,
        speed: F64,
        heading: F64,
        msg_cnt: int = 0,
        accuracy_m: float = math.nan,
    ) -> tuple[NDArray[np.uint8], F64, I64, NDArray[np.bool_]]:
        """Return outcome, x_m (NaN if rejected), sequence gap and whether the odometer is new, for one round."""
        n = len(rows)
        times = np.broadcast_to(np.asarray(t_us, np.int64), n).copy()
        numbers = columns_of(times, np.full(n, msg_cnt % 128), lat, lon, speed, heading, np.full(n, accuracy_m))
        done = advance(self.tracks, rows, numbers, np.arange(n), 5.0)
        x_m = np.where(done.outcome == Outcome.SCORED, self.tracks["x_m"][rows], np.nan)
        return done.outcome, x_m, done.sequence_gap, done.initialised

    def extend_path_history(
        self, rows: I64, location_valid: NDArray[np.bool_], v_mps: F64, innovation_std_m: float = 0.01
    ) -> None:
        """Pass the verdicts on."""
        extend_path_history(self.tracks, rows, location_valid, v_mps, np.full(len(rows), innovation_std_m**2))

    def find_leaders(self, rows: I64, t_us: int, declared: dict[int, int] | None = None) -> NDArray[np.bool_]:
        """Return which rows have another leader than before."""
        changed = np.empty(len(rows), np.bool_)
        named = np.array([(declared or {}).get(int(row), NO_LEADER) for row in rows], np.int64)
        find_leaders(self.tracks, self.pairing, self.grid, rows, named, t_us, self.range_m, self.lane_width_m, changed)
        return changed

    def leaders(self) -> list[int]:
        """Return the leader of each row."""
        return [int(leader_of(self.tracks, self.pairing, row)) for row in range(self.capacity)]

    def gap_m(self, row: int) -> float:
        """Return the gap of one row."""
        gap = np.empty(1)
        gaps_m(self.tracks, self.pairing, np.array([row]), gap)
        return float(gap[0])


@dataclass
class Noise:
    """A receiver as measured: position against speed 0.008 m a step, speed 0.02 m/s, heading 0.3 degrees."""

    seed: int
    step_m: float = 0.008
    speed_mps: float = 0.02
    heading_deg: float = 0.3
    walk: dict[int, NDArray[np.float64]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.rng = np.random.default_rng(self.seed)

    def __call__(self, row: int, _t_s: float, reading: Reading) -> Reading:
        """Return the reading as the receiver gives it; the error of position wanders and stays within a metre."""
        wandered = 0.999 * self.walk.get(row, np.zeros(2)) + self.rng.normal(0.0, self.step_m, 2)
        self.walk[row] = wandered
        lat, lon, speed, heading = reading
        return (
            lat + wandered[1] / 111_200.0,
            lon + wandered[0] / 74_300.0,
            max(0.0, speed + self.rng.normal(0.0, self.speed_mps)),
            (heading + self.rng.normal(0.0, self.heading_deg)) % 360.0,
        )


@dataclass
class Record:
    """What one drive left: per step and car x, speed, leader, gap and whether the leader changed."""

    t_s: F64
    x_m: F64
    v_mps: F64
    leader: I64
    gap_m: F64
    changed: NDArray[np.bool_]

    def takeovers(self, row: int) -> list[tuple[float, int]]:
        """Return (time, new leader) of each change of leader of one car."""
        at = np.flatnonzero(np.diff(self.leader[:, row], prepend=NO_LEADER))
        return [(round(float(self.t_s[k]), 3), int(self.leader[k, row])) for k in at]


def drive(
    world: World,
    cars: list[Car],
    seconds: float,
    *,
    start_s: float = 0.0,
    noise: Spoil | None = None,
    location_valid: Callable[[int, float], bool] = lambda _row, _t: True,
    declared: dict[int, int] | None = None,
    shuffle_seed: int | None = None,
    silent: Callable[[int, float], bool] = lambda _row, _t: False,
) -> Record:
    """Drive car i as row i; `noise(row, t_s, reading)` spoils readings; `location_valid(row, t_s)` is the verdict."""
    steps = round(seconds / STEP_S)
    n = len(cars)
    record = Record(
        start_s + STEP_S * np.arange(steps),
        np.full((steps, n), np.nan),
        np.full((steps, n), np.nan),
        np.full((steps, n), NO_LEADER),
        np.full((steps, n), np.nan),
        np.zeros((steps, n), np.bool_),
    )
    rng = np.random.default_rng(shuffle_seed)
    for k, t_s in enumerate(record.t_s):
        rows = np.array([row for row in range(n) if not silent(row, t_s)], np.int64)
        if shuffle_seed is not None:
            rng.shuffle(rows)
        readings = [cars[row].reading(t_s) for row in rows]
        if noise is not None:
            readings = [noise(int(row), t_s, reading) for row, reading in zip(rows, readings, strict=True)]
        if not readings:
            continue
        lat, lon, speed, heading = (np.array(column) for column in zip(*readings, strict=True))
        t_us = START_US + round(t_s * 1e6)
        _, x_m, _, _ = world.advance(rows, t_us, lat, lon, speed, heading, msg_cnt=k)
        true_v = np.array([cars[row].reading(t_s)[2] for row in rows])
        world.extend_path_history(rows, np.array([location_valid(int(row), t_s) for row in rows]), true_v)
        record.changed[k, rows] = world.find_leaders(rows, t_us, declared)
        record.x_m[k, rows] = x_m
        record.v_mps[k, rows] = speed
        record.leader[k] = world.leaders()[:n]
        record.gap_m[k] = [world.gap_m(row) for row in range(n)]
    return record
