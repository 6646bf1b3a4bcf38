"""Anomalies with their labels: Algorithm 1 of Wang, Masoud, Khojandi (T-ITS 22(3), 2021), with `short` and `miss`.

At each sample, on each sensor separately, an event starts with probability p if none is active there; its kind is
uniform over the kinds asked for, its duration uniform over a range of samples. With c the severity (a variance, so in
m^2 for the location and (m/s)^2 for the speed) an event adds to the sensor's readings

    noise   N(0, c), drawn again for each sample
    bias    one N(0, c) for the whole event
    drift   +- a ramp from 0 to U(0, 1) c (a ramp of one sample is its end, so that every event changes a reading)
    short   N(0, c) in one sample, whatever the range of durations

and `miss` makes both readings absent: the message is never sent. Messages 100 to 600 ms apart are ordinary congestion
control (SAE J2945/1), hence a miss lasts at least 7 samples, 0.8 s from reading to reading at 10 Hz.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import IntEnum, StrEnum
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
Codes = NDArray[np.uint8]

MISS_SAMPLES_MIN = 7


class SpecError(ValueError):
    """An injection that is not possible: one line with the problem and what to write instead."""


class Sensor(StrEnum):
    """Which of the sender's readings an event corrupts; `both` for kinds that keep them consistent."""

    LOCATION = "location"
    SPEED = "speed"
    BOTH = "both"
    LINK = "link"


class Kind(IntEnum):
    """Codes of the per-sample labels; `label` is the word on the command line and on the wire."""

    NONE = 0
    NOISE = 1
    BIAS = 2
    DRIFT = 3
    SHORT = 4
    MISS = 5
    FEIGNED_BRAKE = 6
    DRAG = 7
    REPLAY = 8
    FREEZE = 9

    @property
    def label(self) -> str:
        """The word for this kind, such as `feigned-brake`."""
        return self.name.lower().replace("_", "-")

    @property
    def is_consistent(self) -> bool:
        """Whether location and speed are falsified together, each in keeping with the other."""
        return self >= Kind.FEIGNED_BRAKE


ALGORITHM_1 = (Kind.NOISE, Kind.BIAS, Kind.DRIFT)
BY_LABEL: Mapping[str, Kind] = MappingProxyType({kind.label: kind for kind in Kind if kind is not Kind.NONE})


@dataclass(frozen=True, slots=True, kw_only=True)
class Spec:
    """What to inject. `c` variance (m^2 and (m/s)^2), `p` starts per sample, `samples` range of durations, inclusive.

    `share` is the part of the vehicles that misbehave at all (1 = everyone), chosen by the replay.
    """

    c: float = 1.0
    p: float = 0.005
    kinds: tuple[Kind, ...] = ALGORITHM_1
    samples: tuple[int, int] = (1, 20)
    share: float = 1.0

    def __post_init__(self) -> None:
        if not (np.isfinite(self.c) and self.c > 0):
            raise SpecError(f"c is a variance and must be above 0, not {self.c:g}")
        if not 0 <= self.p <= 1:
            raise SpecError(f"p is a probability per sample, between 0 and 1, not {self.p:g}")
        if not 0 <= self.share <= 1:
            raise SpecError(f"share is the part of the vehicles that misbehave, between 0 and 1, not {self.share:g}")
        if not 1 <= self.samples[0] <= self.samples[1]:
            raise SpecError(f"d is a range of samples such as 1..20, not {self.samples[0]}..{self.samples[1]}")
        if not self.kinds or Kind.NONE in self.kinds:
            raise SpecError(f"kinds must name at least one of {', '.join(BY_LABEL)}")


@dataclass(frozen=True, slots=True)
class Injected:
    """One event: samples `start` to `stop` (exclusive) of one sensor."""

    sensor: Sensor
    kind: Kind
    start: int
    stop: int


@dataclass(frozen=True, slots=True)
class Corrupted:
    """Readings as the sender gives them, and the truth about them. Shapes (n,): one entry per sample.

    What `x_m`, `v_mps` hold where `present` is false is never sent. `x_kind`, `v_kind` are codes of `Kind`; `events`
    are in order of their start, and those that fall wholly into a silence are left out.
    """

    x_m: F64
    v_mps: F64
    present: NDArray[np.bool_]
    x_kind: Codes
    v_kind: Codes
    events: tuple[Injected, ...]

    @property
    def anomalous(self) -> NDArray[np.bool_]:
        """(n,) whether either sensor is faulty in this sample, or silent."""
        return np.logical_or(self.x_kind, self.v_kind)


def inject(rng: np.random.Generator, x_m: F64, v_mps: F64, spec: Spec) -> Corrupted:
    """Corrupt a drive's readings; the arguments are left as they are.

    Parameters
    ----------
    rng
        Source of all chance: the same state gives the same events.
    x_m, v_mps
        (n,) location along the road and speed, sample by sample.
    spec
        What to inject. Consistent kinds are not of this function.

    Raises
    ------
    SpecError
        When `spec` asks for a consistent kind.
    """
    unsupported = [kind.label for kind in spec.kinds if kind.is_consistent]
    if unsupported:
        raise SpecError(f"{', '.join(unsupported)} falsifies location and speed together, not sensor by sensor")
    n = len(x_m)
    readings = {Sensor.LOCATION: x_m.copy(), Sensor.SPEED: v_mps.copy()}
    codes = {Sensor.LOCATION: np.zeros(n, np.uint8), Sensor.SPEED: np.zeros(n, np.uint8)}
    events: list[Injected] = []
    additive = tuple(kind for kind in spec.kinds if kind is not Kind.MISS)
    for sensor in (Sensor.LOCATION, Sensor.SPEED):
        for kind, start, length in occurrences(rng, n, additive, spec):
            stop = min(start + length, n)
            readings[sensor][start:stop] += OFFSETS[kind](rng, length, spec.c)[: stop - start]
            codes[sensor][start:stop] = kind
            events.append(Injected(sensor, kind, start, stop))
    present = np.ones(n, np.bool_)
    if Kind.MISS in spec.kinds:
        for kind, start, length in occurrences(rng, n, (Kind.MISS,), spec):
            stop = min(start + length, n)
            present[start:stop] = False
            events.append(Injected(Sensor.LINK, kind, start, stop))
        for code in codes.values():
            code[~present] = Kind.MISS
        events = [event for event in events if event.sensor is Sensor.LINK or present[event.start : event.stop].any()]
    events.sort(key=lambda event: (event.start, event.sensor))
    return Corrupted(
        readings[Sensor.LOCATION],
        readings[Sensor.SPEED],
        present,
        codes[Sensor.LOCATION],
        codes[Sensor.SPEED],
        tuple(events),
    )


def occurrences(rng: np.random.Generator, n: int, kinds: tuple[Kind, ...], spec: Spec) -> list[tuple[Kind, int, int]]:
    """Kind, first sample and length of each event among n samples; a later event starts after the end of an earlier.

    The wait for an event that starts with probability p per idle sample is geometric, so it is drawn at once.
    """
    found: list[tuple[Kind, int, int]] = []
    if not kinds or spec.p == 0:
        return found
    start = int(rng.geometric(spec.p)) - 1
    while start < n:
        kind = kinds[int(rng.integers(len(kinds)))]
        length = _length(rng, kind, spec.samples)
        found.append((kind, start, length))
        start += length + int(rng.geometric(spec.p)) - 1
    return found


def _length(rng: np.random.Generator, kind: Kind, samples: tuple[int, int]) -> int:
    if kind is Kind.SHORT:
        return 1
    shortest, longest = samples
    if kind is Kind.MISS:
        shortest = max(shortest, MISS_SAMPLES_MIN)
    return int(rng.integers(shortest, max(shortest, longest), endpoint=True))


def _noise(rng: np.random.Generator, length: int, c: float) -> F64:
    return rng.normal(0.0, np.sqrt(c), length)


def _bias(rng: np.random.Generator, length: int, c: float) -> F64:
    return np.full(length, rng.normal(0.0, np.sqrt(c)))


def _drift(rng: np.random.Generator, length: int, c: float) -> F64:
    end = rng.choice((-1.0, 1.0)) * rng.uniform(0.0, 1.0) * c
    return np.linspace(0.0, end, length) if length > 1 else np.array([end])


OFFSETS: Mapping[Kind, Callable[[np.random.Generator, int, float], F64]] = MappingProxyType(
    {Kind.NOISE: _noise, Kind.BIAS: _bias, Kind.DRIFT: _drift, Kind.SHORT: _noise}
)
