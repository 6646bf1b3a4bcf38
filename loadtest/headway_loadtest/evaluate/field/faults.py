"""Algorithm 1 on the messages of recorded vehicles: false speeds, and positions moved along the heading."""

import zlib
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from headway_loadtest.evaluate.field.recordings import Recording, assemble, move
from headway_loadtest.inject.apply import sendable_speed
from headway_loadtest.inject.faults import ALGORITHM_1, Kind, Sensor, Spec, inject

STARTS_PER_SAMPLE = 0.005


@dataclass(frozen=True, slots=True)
class Fault:
    """One injected event; event times of its first and last message. A fault of one message is a `short`."""

    vehicle: str
    sensor: Sensor
    kind: Kind
    start_us: int
    stop_us: int


def rng_of(seed: Iterable[int], vehicle: str) -> np.random.Generator:
    """Return a generator that depends on the seed and the vehicle's name alone, so the company does not matter."""
    return np.random.default_rng([*seed, zlib.crc32(vehicle.encode())])


def with_faults(recording: Recording, c: float, seed: int, run: int) -> tuple[Recording, list[Fault]]:
    """Return the recording with faults of variance `c` in every vehicle, and the faults.

    Durations are 1 to 20 messages of the vehicle. A speed that would fall
    below 0 is reported as far above the true one.
    """
    faults: list[Fault] = []
    tracks = recording.tracks
    for name, track in zip(recording.vehicles, tracks, strict=True):
        spec = Spec(c=c, p=STARTS_PER_SAMPLE, kinds=ALGORITHM_1)
        speed = track["speed_mps"].copy()
        made = inject(rng_of((seed, run), name), np.zeros(len(track)), speed, spec)
        move(track, made.x_m)
        track["speed_mps"] = sendable_speed(speed, made.v_mps)
        for event in made.events:
            kind = Kind.SHORT if event.stop - event.start == 1 else event.kind
            times = track["t_us"][[event.start, event.stop - 1]].tolist()
            faults.append(Fault(name, event.sensor, kind, *times))
    return assemble(recording, tracks), faults
