"""What a recording itself shows around an alarm: the cause that it is counted under."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from headway_loadtest.evaluate.field.detection import Alarm
from headway_loadtest.evaluate.field.recordings import Recording, Records, local_m
from headway_loadtest.sources.drive import F64, I64

Bools = NDArray[np.bool_]
GAP_LEAST_S = 0.7
"""Silence that congestion control does not explain (SAE J2945/1 allows 0.6 s)."""
GAP_INTERVALS = 3.0
"""A gap is at least so many of the sender's own intervals."""
GAP_WITHIN_S = 4.0
MOVING_MPS = 3.0
STANDSTILL_MPS = 0.5
AROUND_S = 1.0
"""How long before the onset a cause may lie."""
JUMP_M = 1.5
"""Step minus mean speed x time that no receiver of the public recordings makes without an error."""
REPEATED_MPS = 1.0
"""Above this speed a repeated position is an old one."""
FROZEN_S, FROZEN_MPS = 1.5, 2.0
"""A speed is frozen when it is repeated so long while positions move at a speed that differs by so much."""
BRAKE_MPS2 = 3.0
FAULTS_OF_THE_DATA = ("recording-gap", "position-jump", "frozen-speed")
CAUSES = (*FAULTS_OF_THE_DATA, "end-of-track", "repeated-position", "standstill", "low-speed", "hard-braking", "none")


@dataclass(frozen=True, slots=True)
class Facts:
    """What one vehicle's recorded messages show. Shapes (n,), of its messages in event-time order."""

    t_us: I64
    speed_mps: F64
    gap_before: Bools
    at: Mapping[str, Bools]
    """Whether a cause is seen at a message, by the name of the cause."""

    @classmethod
    def of(cls, track: Records) -> "Facts":
        """Look through one vehicle's messages."""
        t_us, speed = track["t_us"], track["speed_mps"]
        n = len(track)
        if not n:
            nothing = np.zeros(0, np.bool_)
            return cls(t_us, speed, nothing, {})
        dt_s = np.diff(t_us, prepend=t_us[0]) / 1e6
        interval_s = float(np.median(dt_s[1:])) if n > 1 else 0.1
        gap = dt_s > max(GAP_LEAST_S, GAP_INTERVALS * interval_s)
        north, east = local_m(track, float(track["lat_deg"][0]), float(track["lon_deg"][0]))
        step_m = np.hypot(np.diff(north, prepend=north[0]), np.diff(east, prepend=east[0]))
        mean_mps = 0.5 * (speed + np.r_[speed[:1], speed[:-1]])
        return cls(
            t_us,
            speed,
            gap,
            {
                "position-jump": ~gap & (np.abs(step_m - mean_mps * dt_s) > JUMP_M),
                "frozen-speed": _frozen(t_us, speed, step_m, gap),
                "repeated-position": (step_m < 1e-3) & (mean_mps > REPEATED_MPS) & ~gap & (np.arange(n) > 0),
                "standstill": speed < STANDSTILL_MPS,
                "low-speed": speed < MOVING_MPS,
                "hard-braking": np.abs(_acceleration(t_us, speed)) > BRAKE_MPS2,
            },
        )

    def near_gap(self, t_us: int) -> bool:
        """Whether the recording has a gap that ends within `GAP_WITHIN_S` of a time."""
        return bool(self.near_gaps(np.array([t_us]))[0])

    def near_gaps(self, t_us: I64) -> Bools:
        """(m,) whether the recording has a gap that begins or ends within `GAP_WITHIN_S` of each time."""
        ends = np.flatnonzero(self.gap_before)
        near = np.zeros(len(t_us), np.bool_)
        within_us = GAP_WITHIN_S * 1e6
        for i in ends.tolist():
            near |= (t_us >= self.t_us[i - 1] - within_us) & (t_us <= self.t_us[i] + within_us)
        return near

    @property
    def moving(self) -> Bools:
        """(n,) whether the vehicle drives faster than `MOVING_MPS` and no gap is near."""
        moving: Bools = (self.speed_mps > MOVING_MPS) & ~self.near_gaps(self.t_us)
        return moving

    @property
    def interval_h(self) -> F64:
        """(n,) hours since the message before; 0 over a gap."""
        hours: F64 = np.where(self.gap_before, 0.0, np.diff(self.t_us, prepend=self.t_us[:1])) / 3.6e9
        return hours

    def cause(self, alarm: Alarm) -> str:
        """Name the first cause of `CAUSES` that is seen within `AROUND_S` of the onset."""
        start_us = alarm.start_us
        if self.near_gap(start_us):
            return "recording-gap"
        if alarm.newest.kind == "miss" and start_us >= self.t_us[-1]:
            return "end-of-track"
        around = np.abs(self.t_us - start_us) <= AROUND_S * 1e6
        return next((name for name in CAUSES if name in self.at and self.at[name][around].any()), "none")

    def is_moving(self, t_us: int) -> bool:
        """Whether the newest message at a time belongs to the moving slice."""
        at = int(np.searchsorted(self.t_us, t_us, "right")) - 1
        return at >= 0 and bool(self.speed_mps[at] > MOVING_MPS) and not self.near_gap(t_us)


def facts_of(recording: Recording) -> dict[str, Facts]:
    """Return the facts of each vehicle, by its name."""
    return {name: Facts.of(track) for name, track in zip(recording.vehicles, recording.tracks, strict=True)}


def _acceleration(t_us: I64, speed_mps: F64) -> F64:
    """Return the mean acceleration over the half second before each message."""
    before = np.searchsorted(t_us, t_us - 500_000, "right") - 1
    before = np.maximum(before, 0)
    elapsed_s = (t_us - t_us[before]) / 1e6
    change: F64 = speed_mps - speed_mps[before]
    accel: F64 = np.divide(change, elapsed_s, out=np.zeros_like(change), where=elapsed_s > 0.0)
    return accel


def _frozen(t_us: I64, speed_mps: F64, step_m: F64, gap: Bools) -> Bools:
    """(n,) whether the speed has been the same for `FROZEN_S` while positions moved at another."""
    frozen = np.zeros(len(t_us), np.bool_)
    changes = np.flatnonzero(np.r_[True, np.diff(speed_mps) != 0.0] | gap)
    for start, stop in zip(changes, np.r_[changes[1:], len(t_us)], strict=True):
        elapsed_s = (t_us[stop - 1] - t_us[start]) / 1e6
        if elapsed_s >= FROZEN_S:
            moved_mps = step_m[start + 1 : stop].sum() / elapsed_s
            frozen[start:stop] = abs(moved_mps - speed_mps[start]) > FROZEN_MPS
    return frozen
