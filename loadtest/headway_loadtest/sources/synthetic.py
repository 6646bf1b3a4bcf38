"""A synthetic fleet: platoons of drivers whose model is not that of the filter, each platoon on its own ring road.

Drivers follow the full velocity difference model (Jiang, Wu, Zhu 2001, doi:10.1103/PhysRevE.64.017101), each with
parameters of its own, a reaction delay, and a random imperfection:

    a(t) = kappa (V(gap) - v) + lambda (v_leader - v) + w(t),    gap, v and v_leader as they were a reaction ago
    V(gap) = v_max (tanh((gap - s0) / b - c) + tanh(c)) / (1 + tanh(c)),    w an Ornstein-Uhlenbeck process

The head of a platoon chooses a speed (free, slow, or standing), changes it at random times, and reaches it at a
moderate rate. Sensor noise is that of real receivers: 0.008 m per reading between displacement and speed, speed noise
0.02 m/s, a constant speed offset of up to 0.05 m/s.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from headway_loadtest.sources.drive import F64, I64, Ahead, Drive, Scene
from headway_loadtest.sources.road import radii_m

STEP_MS = 100
PLATOON = 10
JITTER_MS = 2

RING_RADIUS_M = 400.0
RINGS_APART_M = 1_100.0
RINGS_IN_A_ROW = 50
ORIGIN_LAT, ORIGIN_LON = 42.1, -84.2

DELAY_S = (0.2, 0.6)
ACCEL_MIN_MPS2, ACCEL_MAX_MPS2 = -6.0, 2.5
JERK_MPS3 = 5.0
"""Limit of the jerk: full braking takes half a second to build up."""
BRAKE_GAP_M = 1.0
HEAD_SPEEDS_MPS = (0.0, 6.0, 9.0, 12.0, 15.0, 17.0)
HEAD_CHANGES_S = 15.0
HEAD_RATES_MPS2 = (-2.0, 1.3)
HEAD_GAIN_HZ = 0.8
IMPERFECTION_MPS2, IMPERFECTION_S = 0.15, 5.0
POSITION_STEP_M, POSITION_MEMORY_S = 0.008, 30.0
SPEED_NOISE_MPS, SPEED_OFFSET_MPS = 0.02, 0.05


class Readings(NamedTuple):
    """What n vehicles read in one step; arrays (n,). `t_ms` is event time since the fleet set off."""

    t_ms: I64
    x_m: F64
    speed_mps: F64
    lat: F64
    lon: F64
    heading_deg: F64


class Fleet:
    """n vehicles in platoons, advanced a step at a time; the same arguments give the same readings.

    Each vehicle reads its sensors at its own phase within the step, in the window [from, to) of milliseconds, with a
    jitter of 2 ms; an empty window makes them read all at once. `first` is the number of the fleet's first vehicle,
    which also places its roads: fleets with different vehicles never meet.
    """

    def __init__(
        self, n: int, seed: int, *, first: int = 0, window_ms: tuple[int, int] = (0, STEP_MS), step_ms: int = STEP_MS
    ) -> None:
        self._rng = rng = np.random.default_rng((seed, first))
        self._step = 0
        self._step_ms = step_ms
        self._step_s = step_ms / 1000
        self.length_m = rng.uniform(3.8, 5.2, n)
        self._place(n, first)
        self._draw_drivers(n)
        self._set_off(n)
        low, high = window_ms
        self._window_ms = window_ms
        self._phase_ms = rng.integers(low, high, n) if high > low else np.full(n, low)

    def _place(self, n: int, first: int) -> None:
        number = first + np.arange(n)
        platoon = number // PLATOON
        self._is_head = (number % PLATOON == 0) | (np.arange(n) == 0)
        self._leader = np.where(self._is_head, np.arange(n), np.arange(n) - 1)
        meridian_m, normal_m = radii_m(ORIGIN_LAT)
        self._centre_lat = ORIGIN_LAT + np.degrees((platoon // RINGS_IN_A_ROW) * RINGS_APART_M / meridian_m)
        apart_rad = RINGS_APART_M / (normal_m * np.cos(np.radians(ORIGIN_LAT)))
        self._centre_lon = ORIGIN_LON + np.degrees((platoon % RINGS_IN_A_ROW) * apart_rad)
        meridian_m, normal_m = radii_m(self._centre_lat)
        self._lat_per_m = np.degrees(1.0 / meridian_m)
        self._lon_per_m = np.degrees(1.0 / (normal_m * np.cos(np.radians(self._centre_lat))))

    def _draw_drivers(self, n: int) -> None:
        rng = self._rng
        self._kappa = rng.uniform(0.4, 0.8, n)
        self._lambda = rng.uniform(0.6, 1.0, n)
        self._v_max_mps = rng.uniform(17.0, 23.0, n)
        self._s0_m = rng.uniform(1.5, 3.0, n)
        self._b_m = rng.uniform(10.0, 14.0, n)
        self._c = rng.uniform(1.0, 1.3, n)
        self._delay = np.round(rng.uniform(*DELAY_S, n) / self._step_s).astype(np.int64)
        self._offset_mps = rng.uniform(-SPEED_OFFSET_MPS, SPEED_OFFSET_MPS, n)

    def _set_off(self, n: int) -> None:
        v_mps = self._rng.uniform(6.0, 14.0, n)[np.maximum.accumulate(np.where(self._is_head, np.arange(n), 0))]
        tanh_c = np.tanh(self._c)
        level = np.clip(v_mps / self._v_max_mps * (1 + tanh_c) - tanh_c, -0.95, 0.95)
        gap_m = self._s0_m + self._b_m * (self._c + np.arctanh(level))
        back_m = np.cumsum(np.where(self._is_head, 0.0, gap_m + self.length_m[self._leader]))
        head_m = np.maximum.accumulate(np.where(self._is_head, back_m, 0.0))
        self._x_m = PLATOON * 40.0 - (back_m - head_m)
        self._v_mps = v_mps
        self._goal_mps = v_mps.copy()
        self._wish_mps = v_mps.copy()
        self._accel_mps2 = np.zeros(n)
        self._imperfection_mps2 = np.zeros(n)
        self._along_m = np.zeros(n)
        self._across_m = np.zeros(n)
        self._seen = np.empty((int(self._delay.max()) + 1, 3, n))
        self._seen[:] = self._sight()

    def step(self) -> Readings:
        """Read all sensors, then drive on for a step."""
        step_s = self._step_s
        most_mps2 = JERK_MPS3 * step_s
        accel_mps2 = np.clip(self._drive(), self._accel_mps2 - most_mps2, self._accel_mps2 + most_mps2)
        self._accel_mps2 = accel_mps2 = np.maximum(accel_mps2, -self._v_mps / step_s)
        readings = self._read(accel_mps2)
        self._x_m += (self._v_mps + accel_mps2 * step_s / 2) * step_s
        self._v_mps += accel_mps2 * step_s
        self._step += 1
        return readings

    def _sight(self) -> F64:
        """(3, n) what each driver sees now: gap, own speed, speed difference."""
        gap_m = self._x_m[self._leader] - self._x_m - self.length_m[self._leader]
        return np.stack([gap_m, self._v_mps, self._v_mps[self._leader] - self._v_mps])

    def _drive(self) -> F64:
        rng, n = self._rng, len(self._v_mps)
        now = self._step % len(self._seen)
        self._seen[now] = self._sight()
        gap_m, v_mps, closing_mps = self._seen[(now - self._delay) % len(self._seen), :, np.arange(n)].T
        tanh_c = np.tanh(self._c)
        wished_mps = self._v_max_mps * (np.tanh((gap_m - self._s0_m) / self._b_m - self._c) + tanh_c) / (1 + tanh_c)
        decay = self._step_s / IMPERFECTION_S
        kick_mps2 = IMPERFECTION_MPS2 * np.sqrt(2 * decay)
        self._imperfection_mps2 += kick_mps2 * rng.standard_normal(n) - decay * self._imperfection_mps2
        accel = self._kappa * (wished_mps - v_mps) + self._lambda * closing_mps + self._imperfection_mps2
        accel = np.where(self._is_head, HEAD_GAIN_HZ * (self._wish() - self._v_mps) + self._imperfection_mps2, accel)
        touching = ~self._is_head & (self._seen[now, 0] < BRAKE_GAP_M)
        return np.where(touching, ACCEL_MIN_MPS2, np.clip(accel, ACCEL_MIN_MPS2, ACCEL_MAX_MPS2))

    def _wish(self) -> F64:
        """(n,) speed that the head of a platoon is after at the moment; unused for the others."""
        changing = self._is_head & (self._rng.random(len(self._goal_mps)) < self._step_s / HEAD_CHANGES_S)
        self._goal_mps[changing] = self._rng.choice(HEAD_SPEEDS_MPS, int(changing.sum()))
        slow, fast = HEAD_RATES_MPS2
        self._wish_mps += np.clip(self._goal_mps - self._wish_mps, slow * self._step_s, fast * self._step_s)
        return self._wish_mps

    def _read(self, accel_mps2: F64) -> Readings:
        rng, n = self._rng, len(self._v_mps)
        low, high = self._window_ms
        within_ms = self._phase_ms
        if high > low:
            within_ms = np.clip(within_ms + rng.integers(-JITTER_MS, JITTER_MS + 1, n), low, high - 1)
        after_s = within_ms / 1000
        x_m = self._x_m + (self._v_mps + accel_mps2 * after_s / 2) * after_s
        v_mps = self._v_mps + accel_mps2 * after_s
        decay = self._step_s / POSITION_MEMORY_S
        self._along_m += POSITION_STEP_M * rng.standard_normal(n) - decay * self._along_m
        self._across_m += POSITION_STEP_M * rng.standard_normal(n) - decay * self._across_m
        angle = (x_m + self._along_m) / RING_RADIUS_M
        radius_m = RING_RADIUS_M + self._across_m
        moving = np.minimum(v_mps, 1.0)
        return Readings(
            t_ms=self._step * self._step_ms + within_ms,
            x_m=x_m + self._along_m,
            speed_mps=np.maximum(v_mps + moving * self._offset_mps + SPEED_NOISE_MPS * rng.standard_normal(n), 0.0),
            lat=self._centre_lat + radius_m * np.sin(angle) * self._lat_per_m,
            lon=self._centre_lon + radius_m * np.cos(angle) * self._lon_per_m,
            heading_deg=np.degrees(-angle) % 360.0,
        )


@dataclass(frozen=True, slots=True)
class SyntheticDrives:
    """`synthetic:N`: the fleet's drives of so many seconds, a scene per platoon."""

    vehicles: int
    seconds: float
    seed: int

    def __iter__(self) -> Iterator[Scene]:
        for first in range(0, self.vehicles, PLATOON):
            yield drives(min(PLATOON, self.vehicles - first), self.seconds, self.seed, first=first)


@dataclass(frozen=True, slots=True)
class SyntheticPairs:
    """Pairs out of platoons of three: the last car, with a forward sensor, and the car that it follows."""

    pairs: int
    seconds: float
    seed: int

    def __iter__(self) -> Iterator[Scene]:
        for first in range(0, self.pairs * PLATOON, PLATOON):
            _, leader, host = drives(3, self.seconds, self.seed, first=first)
            yield replace(host, ahead=_seen(host, leader)), leader


def _seen(host: Drive, leader: Drive) -> Ahead:
    """Return what the forward sensor reads: the leader as it is when the host sends."""
    x_m = np.interp(host.t_s, leader.t_s, leader.x_m)
    v_mps = np.interp(host.t_s, leader.t_s, leader.speed_mps)
    return Ahead(
        ids=(leader.vehicle,),
        which=np.zeros(len(host.t_s), np.int64),
        range_m=x_m - host.x_m - (leader.length_m or 0.0),
        range_rate_mps=v_mps - host.speed_mps,
    )


def drives(n: int, seconds: float, seed: int, *, first: int = 0, window_ms: tuple[int, int] = (0, STEP_MS)) -> Scene:
    """Whole drives of a fleet of n vehicles."""
    fleet = Fleet(n, seed, first=first, window_ms=window_ms)
    steps = [fleet.step() for _ in range(max(1, round(1000 * seconds / STEP_MS)))]
    t_ms, *columns = (np.stack(column, axis=1) for column in zip(*steps, strict=True))
    return tuple(
        Drive(
            vehicle=vehicle_id(first + i),
            t_s=t_ms[i] / 1000,
            length_m=float(fleet.length_m[i]),
            **dict(zip(Readings._fields[1:], (column[i] for column in columns), strict=True)),
        )
        for i in range(n)
    )


def vehicle_id(number: int, life: int = 0) -> str:
    """Name a synthetic vehicle in its nth life: pseudonyms rotate."""
    return f"syn-{number:06d}" if life == 0 else f"syn-{number:06d}-{life}"
