"""Frames of a synthetic fleet of any size for any time: stepped as it is sent, in bounded memory."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from headway_loadtest.inject.apply import Label, sendable_speed
from headway_loadtest.inject.faults import F64, Injected, Kind, Spec, inject
from headway_loadtest.sources.road import displace
from headway_loadtest.sources.synthetic import STEP_MS, Fleet, Readings, vehicle_id
from headway_loadtest.traffic.frames import MSG_CNT_MASK, Frame, Vehicle
from headway_loadtest.traffic.surge import Surge

COHORT = 1000


class FleetFrames:
    """Frames of `vehicles` synthetic vehicles, a message every `step_ms` from each, for so many seconds.

    The fleet is stepped in cohorts of 1000, each with a window of its own in every step, so that none holds up the
    sending for longer than a fraction of a millisecond. With `burst` everyone sends at the same instant. With
    `rotate_s` each vehicle takes a new identifier that often, at a time of its own. An injection is of sensor kinds.
    The vehicles of a `surge` have no faults and do not rotate. The frames can be played once.
    """

    def __init__(
        self,
        vehicles: int,
        seconds: float,
        *,
        seed: int = 0,
        inject: Spec | None = None,
        burst: bool = False,
        rotate_s: float = np.inf,
        step_ms: int = STEP_MS,
        surge: Surge | None = None,
    ) -> None:
        self._steps = round(1000 * seconds / step_ms)
        firsts = list(range(0, vehicles, COHORT))
        surging = [] if surge is None else list(range(vehicles, vehicles + surge.vehicles, COHORT))
        cohorts = len(firsts) + len(surging)
        bounds = np.zeros(cohorts + 1, int) if burst else np.arange(cohorts + 1) * step_ms // cohorts
        places = np.argsort([*_spread(firsts), *_spread(surging)], kind="stable").argsort()
        windows = [(int(bounds[place]), int(bounds[place + 1])) for place in places]

        def cohort(first: int, end: int, window_ms: tuple[int, int], steps: range, inject: Spec | None) -> _Cohort:
            n = min(COHORT, end - first)
            fleet = Fleet(n, seed, first=first, window_ms=window_ms, step_ms=step_ms)
            faults = _Faults(np.random.default_rng((seed, first, 1)), n, len(steps), inject)
            return _Cohort(fleet, first, step_ms, faults, rotate_s if first < vehicles else np.inf, steps)

        made = [
            cohort(first, vehicles, window_ms, range(self._steps), inject)
            for first, window_ms in zip(firsts, windows, strict=False)
        ]
        if surge is not None:
            steps = range(*(round(1000 * at_s / step_ms) for at_s in (surge.start_s, surge.stop_s)))
            made += [
                cohort(first, vehicles + surge.vehicles, window_ms, steps, None)
                for first, window_ms in zip(surging, windows[len(firsts) :], strict=True)
            ]
        self._cohorts = [made[i] for i in np.argsort(places)]
        self.labels: list[Label] = [label for cohort in self._cohorts for label in cohort.labels()]

    def __iter__(self) -> Iterator[Frame]:
        for step in range(self._steps):
            for cohort in self._cohorts:
                if step in cohort.steps:
                    yield cohort.frame(step)


def _spread(firsts: list[int]) -> list[float]:
    """Return places from 0 to 1, evenly apart."""
    return [(i + 0.5) / len(firsts) for i in range(len(firsts))]


class _Cohort:
    def __init__(
        self, fleet: Fleet, first: int, step_ms: int, faults: "_Faults", rotate_s: float, steps: range
    ) -> None:
        n = len(fleet.length_m)
        self.steps = steps
        self._fleet = fleet
        self._first = first
        self._step_ms = step_ms
        self._faults = faults
        self._sent = np.zeros(n, np.int64)
        self._life = np.full(n, -1)
        self._rotate_s = rotate_s
        self._head_start_s = np.linspace(0.0, rotate_s, n, endpoint=False) if np.isfinite(rotate_s) else np.zeros(n)

    def frame(self, step: int) -> Frame:
        since = step - self.steps.start
        sent = self._faults.apply(self._fleet.step(), since)
        present = self._faults.present(since)
        order = np.argsort(sent.t_ms, kind="stable")
        if present is not None:
            order = order[present[order]]
        msg_cnt = self._sent[order] & MSG_CNT_MASK
        self._sent[order] += 1
        return Frame(
            entering=self._entering(step),
            t_us=(sent.t_ms[order] + self.steps.start * self._step_ms) * 1000,
            row=order + self._first,
            msg_cnt=msg_cnt,
            lat=sent.lat[order],
            lon=sent.lon[order],
            speed_mps=sent.speed_mps[order],
            heading_deg=sent.heading_deg[order],
        )

    def labels(self) -> list[Label]:
        return [
            Label(
                self._id(row, int(self._lives(event.start)[row])),
                event.sensor,
                event.kind,
                (event.start - (event.kind is Kind.MISS)) * self._step_ms * 1000,
                event.stop * self._step_ms * 1000,
            )
            for row, event in self._faults.events
        ]

    def _entering(self, step: int) -> tuple[Vehicle, ...]:
        life = self._lives(step)
        changed = np.flatnonzero(life != self._life).tolist()
        self._life = life
        return tuple(
            Vehicle(self._first + row, self._id(row, int(life[row])), float(self._fleet.length_m[row]))
            for row in changed
        )

    def _lives(self, step: int) -> NDArray[np.int64]:
        return ((step * self._step_ms / 1000 + self._head_start_s) // self._rotate_s).astype(np.int64)

    def _id(self, row: int, life: int) -> str:
        return vehicle_id(self._first + row, life)


class _Faults:
    """The faults that a cohort adds to its readings, step by step; drawn in advance for the faulty vehicles only."""

    def __init__(self, rng: np.random.Generator, n: int, steps: int, spec: Spec | None) -> None:
        faulty = np.flatnonzero(rng.random(n) < (0.0 if spec is None else spec.share))
        truth = np.zeros(steps)
        drawn = [] if spec is None else [inject(rng, truth, truth, spec) for _ in faulty]
        self._faulty = faulty
        self._n = n
        self._x_m: F64 = np.array([fault.x_m for fault in drawn]).reshape(len(faulty), steps)
        self._v_mps: F64 = np.array([fault.v_mps for fault in drawn]).reshape(len(faulty), steps)
        self._present = np.array([fault.present for fault in drawn], np.bool_).reshape(len(faulty), steps)
        self._silent = not self._present.all()
        self.events = [
            (int(row), event)
            for row, fault in zip(faulty, drawn, strict=True)
            for event in fault.events
            if not _at_an_end(event, steps)
        ]

    def apply(self, truth: Readings, step: int) -> Readings:
        if not len(self._faulty):
            return truth
        rows = self._faulty
        lat, lon = displace(truth.lat[rows], truth.lon[rows], truth.heading_deg[rows], self._x_m[:, step])
        speed_mps = sendable_speed(truth.speed_mps[rows], truth.speed_mps[rows] + self._v_mps[:, step])
        readings = truth._replace(lat=truth.lat.copy(), lon=truth.lon.copy(), speed_mps=truth.speed_mps.copy())
        readings.lat[rows], readings.lon[rows], readings.speed_mps[rows] = lat, lon, speed_mps
        return readings

    def present(self, step: int) -> NDArray[np.bool_] | None:
        """(n,) which vehicles send in this step; None: all."""
        if not self._silent:
            return None
        sends = np.ones(self._n, np.bool_)
        sends[self._faulty] = self._present[:, step]
        return sends


def _at_an_end(event: Injected, steps: int) -> bool:
    return event.kind is Kind.MISS and (event.start == 0 or event.stop == steps)
