"""What ordinary receivers and channels do to honest messages, one thing at a time; and position jumps, as faults.

A degradation takes one vehicle's messages in event-time order and returns those that are received.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from headway_loadtest.evaluate.field.faults import Fault, rng_of
from headway_loadtest.evaluate.field.gnss import shift, walk
from headway_loadtest.evaluate.field.recordings import Recording, Records, assemble, course_deg
from headway_loadtest.inject.faults import Kind, Sensor
from headway_loadtest.sources.drive import F64

WALK_TAU_S = 30.0
OUTAGE_S, OUTAGE_EVERY_S = 5.0, 60.0
JUMP_M, JUMP_S, JUMP_EVERY_S = (5.0, 10.0), (1.0, 5.0), 30.0
JITTER_MOST_S = 0.045
"""Time stamps stay in order at 10 Hz."""
BURST = 5
BURSTS_PER_MESSAGE = 0.02
MPH = 0.44704
KMH = 1 / 3.6
WHITE_M, WHITE_MPS = 0.1, 0.03

Change = Callable[[np.random.Generator, Records], Records]


@dataclass(frozen=True, slots=True)
class Degradation:
    """One ordinary defect. `silences`: it silences the sender for so long that a miss is due."""

    change: Change
    silences: bool = False


def degrade(recording: Recording, name: str, seed: int, run: int) -> Recording:
    """Return the recording with every vehicle degraded, each by chance of its own."""
    change = DEGRADATIONS[name].change
    tracks = [
        change(rng_of((seed, run), vehicle), track) if len(track) > 1 else track
        for vehicle, track in zip(recording.vehicles, recording.tracks, strict=True)
    ]
    return assemble(recording, tracks)


def with_jumps(recording: Recording, seed: int, run: int, *, along: bool) -> tuple[Recording, list[Fault]]:
    """Return the recording with multipath jumps, and the jumps as faults of the location.

    A jump moves positions by 5 to 10 m for 1 to 5 s, in any direction or along the road; the next one begins 30 s
    later on average.
    """
    faults: list[Fault] = []
    tracks = recording.tracks
    for vehicle, track in zip(recording.vehicles, tracks, strict=True):
        rng = rng_of((seed, run), vehicle)
        course = np.radians(course_deg(track))
        north, east = np.zeros(len(track)), np.zeros(len(track))
        for start, stop in _spells(rng, track, JUMP_EVERY_S, JUMP_S):
            size = rng.uniform(*JUMP_M)
            direction = course[start] + rng.choice((0.0, np.pi)) if along else rng.uniform(0.0, 2.0 * np.pi)
            north[start:stop], east[start:stop] = size * np.cos(direction), size * np.sin(direction)
            first, last = track["t_us"][[start, stop - 1]].tolist()
            faults.append(Fault(vehicle, Sensor.LOCATION, Kind.BIAS, first, last))
        shift(track, north, east)
    return assemble(recording, tracks), faults


def _spells(
    rng: np.random.Generator, track: Records, every_s: float, lasting_s: tuple[float, float]
) -> list[tuple[int, int]]:
    """Return slices that begin `every_s` apart on average and last a uniform time; they do not overlap."""
    if not len(track):
        return []
    t_s = (track["t_us"] - track["t_us"][0]) / 1e6
    spells = []
    start_s = float(rng.exponential(every_s))
    while start_s < t_s[-1]:
        stop_s = start_s + float(rng.uniform(*lasting_s))
        start, stop = np.searchsorted(t_s, [start_s, stop_s]).tolist()
        if stop > start:
            spells.append((start, stop))
        start_s = stop_s + float(rng.exponential(every_s))
    return spells


def _white(rng: np.random.Generator, track: Records) -> Records:
    n = len(track)
    shift(track, rng.normal(0.0, WHITE_M, n), rng.normal(0.0, WHITE_M, n))
    return _with_speed(track, track["speed_mps"] + rng.normal(0.0, WHITE_MPS, n))


def _walk(std_m: float) -> Change:
    def change(rng: np.random.Generator, track: Records) -> Records:
        walk(rng, track, std_m, WALK_TAU_S)
        return track

    return change


def _outage(rng: np.random.Generator, track: Records) -> Records:
    received = np.ones(len(track), np.bool_)
    for start, stop in _spells(rng, track, OUTAGE_EVERY_S, (OUTAGE_S, OUTAGE_S)):
        received[start:stop] = False
    return track[received]


def _hold(*names: str) -> Change:
    """Repeat readings until the next full second of the receiver."""

    def change(rng: np.random.Generator, track: Records) -> Records:
        seconds = np.floor(track["t_us"] / 1e6 + rng.uniform())
        first = np.searchsorted(seconds, seconds)
        for name in names:
            track[name] = track[name][first]
        return track

    return change


def _age(age_s: float) -> Change:
    """Report positions as they were `age_s` ago."""

    def change(_rng: np.random.Generator, track: Records) -> Records:
        t_s = track["t_us"] / 1e6
        for name in ("lat_deg", "lon_deg"):
            track[name] = np.interp(t_s - age_s, t_s, track[name])
        known: Records = track[t_s - age_s >= t_s[0]]
        return known

    return change


def _jitter(std_s: float) -> Change:
    def change(rng: np.random.Generator, track: Records) -> Records:
        off_s = np.clip(rng.normal(0.0, std_s, len(track)), -JITTER_MOST_S, JITTER_MOST_S)
        off_us = np.round(off_s * 1e6).astype(np.int64)
        track["t_us"] += off_us
        track["received_us"] += off_us
        return track

    return change


def _scale(part: float) -> Change:
    def change(rng: np.random.Generator, track: Records) -> Records:
        return _with_speed(track, track["speed_mps"] * (1.0 + part * rng.choice((-1.0, 1.0))))

    return change


def _step(step_mps: float) -> Change:
    def change(_rng: np.random.Generator, track: Records) -> Records:
        return _with_speed(track, np.round(track["speed_mps"] / step_mps) * step_mps)

    return change


def _repeat(share: float) -> Change:
    """Send the position before once more instead of the new one."""

    def change(rng: np.random.Generator, track: Records) -> Records:
        new = rng.random(len(track)) >= share
        new[0] = True
        newest = np.maximum.accumulate(np.where(new, np.arange(len(track)), 0))
        for name in ("lat_deg", "lon_deg"):
            track[name] = track[name][newest]
        return track

    return change


def _lose(share: float) -> Change:
    def change(rng: np.random.Generator, track: Records) -> Records:
        return track[rng.random(len(track)) >= share]

    return change


def _lose_bursts(rng: np.random.Generator, track: Records) -> Records:
    """Lose five messages on end, now and then; at least one is received between two bursts."""
    received = np.ones(len(track), np.bool_)
    at = int(rng.geometric(BURSTS_PER_MESSAGE))
    while at < len(track):
        received[at : at + BURST] = False
        at += BURST + int(rng.geometric(BURSTS_PER_MESSAGE))
    return track[received]


def _with_speed(track: Records, speed_mps: F64) -> Records:
    track["speed_mps"] = np.maximum(speed_mps, 0.0)
    return track


DEGRADATIONS: Mapping[str, Degradation] = MappingProxyType(
    {
        "white-0.1m-0.03mps": Degradation(_white),
        "walk-1m": Degradation(_walk(1.0)),
        "walk-3m": Degradation(_walk(3.0)),
        "outage-5s": Degradation(_outage, silences=True),
        "position-1hz": Degradation(_hold("lat_deg", "lon_deg", "heading_deg")),
        "both-1hz": Degradation(_hold("lat_deg", "lon_deg", "heading_deg", "speed_mps")),
        "position-age-0.1s": Degradation(_age(0.1)),
        "position-age-0.5s": Degradation(_age(0.5)),
        "time-jitter-10ms": Degradation(_jitter(0.01)),
        "time-jitter-30ms": Degradation(_jitter(0.03)),
        "speed-scale-1pct": Degradation(_scale(0.01)),
        "speed-scale-3pct": Degradation(_scale(0.03)),
        "speed-step-0.1mps": Degradation(_step(0.1)),
        "speed-step-0.25mph": Degradation(_step(0.25 * MPH)),
        "speed-step-1kmh": Degradation(_step(KMH)),
        "repeated-10pct": Degradation(_repeat(0.1)),
        "loss-30pct": Degradation(_lose(0.3)),
        "loss-bursts-of-5": Degradation(_lose_bursts),
    }
)
JUMPS: Mapping[str, bool] = MappingProxyType({"jump-any-direction": False, "jump-along": True})
"""Jumps by name: whether they are along the road."""
