"""Consistent falsification: a smooth offset of the speed and its integral as position; only other cars expose it.

With v the true speed and s(t) the smooth step 3 t^2 - 2 t^3 from 0 to 1, the reported speed is off by

    feigned-brake   -A / 2 (1 - cos(2 pi t / T)): a dip of A = 3 m/s that lasts T = 4 s
    drag            +-0.7 m/s for 10 s, eased in and out over 1 s
    replay          v(t - lag) - v(t) for 15 s, eased in and out over 3 s: the drive of 10 to 60 s ago, repeated
    freeze          v(0) - v(t) for 10 s, eased out over 3 s: the sender keeps its last speed

No reported speed is negative. After the event the position keeps its offset, because a return would be another event.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np

from headway_loadtest.inject.faults import F64, Corrupted, Injected, Kind, Sensor, Spec, SpecError, occurrences

SAMPLE_S = 0.1
DURATION_S: Mapping[Kind, float] = MappingProxyType(
    {Kind.FEIGNED_BRAKE: 4.0, Kind.DRAG: 10.0, Kind.REPLAY: 15.0, Kind.FREEZE: 10.0}
)
"""Until an offset begins to be eased out."""
EASE_S: Mapping[Kind, float] = MappingProxyType(
    {Kind.FEIGNED_BRAKE: 0.0, Kind.DRAG: 1.0, Kind.REPLAY: 3.0, Kind.FREEZE: 3.0}
)
CONSISTENT = tuple(DURATION_S)

BRAKE_MPS = 3.0
DRAG_MPS = 0.7
REPLAY_LAG_S = (10.0, 60.0)


def inject_consistent(rng: np.random.Generator, x_m: F64, v_mps: F64, spec: Spec) -> Corrupted:
    """Corrupt a drive's readings at 10 Hz by consistent offsets; the arguments are not changed.

    Parameters
    ----------
    rng
        Source of all chance: the same state gives the same events.
    x_m, v_mps
        (n,) location along the road and speed, sample by sample.
    spec
        Only `p` and `kinds` are used; size and duration belong to the kind.

    Raises
    ------
    SpecError
        When `spec` asks for a kind that is not consistent.
    """
    unsupported = [kind.label for kind in spec.kinds if not kind.is_consistent]
    if unsupported:
        raise SpecError(f"{', '.join(unsupported)} falsifies one sensor, not location and speed together")
    n = len(v_mps)
    offset_mps, codes = np.zeros(n), np.zeros(n, np.uint8)
    events: list[Injected] = []
    free_from = 0
    for kind, start, _ in occurrences(rng, n, spec.kinds, spec):
        if start >= free_from:
            stop = min(start + samples(kind), n)
            offset_mps[start:stop] = speed_offset(rng, kind, v_mps, start)
            codes[start:stop] = kind
            events.append(Injected(Sensor.BOTH, kind, start, stop))
            free_from = stop
    return Corrupted(
        x_m + displacement(offset_mps),
        v_mps + offset_mps,
        np.ones(n, np.bool_),
        codes,
        codes.copy(),
        tuple(events),
    )


def samples(kind: Kind) -> int:
    """Return how many samples an event of this kind changes, its easing out included."""
    return round((DURATION_S[kind] + EASE_S[kind]) / SAMPLE_S)


def speed_offset(rng: np.random.Generator, kind: Kind, v_mps: F64, start: int) -> F64:
    """Return the speed offset of an event of `kind` from sample `start` on: at most samples(kind) samples."""
    length = min(samples(kind), len(v_mps) - start)
    t_s: F64 = SAMPLE_S * np.arange(length, dtype=np.float64)
    offset = OFFSETS[kind](rng, t_s, v_mps, start)
    if EASE_S[kind]:
        offset *= smooth_step((DURATION_S[kind] + EASE_S[kind] - t_s) / EASE_S[kind])
    limited: F64 = np.maximum(offset, -v_mps[start : start + length])
    return limited


def displacement(offset_mps: F64) -> F64:
    """Return the integral of a speed offset (n,) sampled at 10 Hz, by the trapezoidal rule, in m; it begins at 0."""
    moved = np.zeros(len(offset_mps))
    np.cumsum(0.5 * SAMPLE_S * (offset_mps[1:] + offset_mps[:-1]), out=moved[1:])
    return moved


def smooth_step(t: F64) -> F64:
    """3 t^2 - 2 t^3 on (0, 1), 0 before and 1 after."""
    u: F64 = np.clip(t, 0.0, 1.0)
    step: F64 = u * u * (3.0 - 2.0 * u)
    return step


def _feigned_brake(_rng: np.random.Generator, t_s: F64, _v_mps: F64, _start: int) -> F64:
    dip: F64 = -0.5 * BRAKE_MPS * (1.0 - np.cos(2.0 * np.pi * t_s / DURATION_S[Kind.FEIGNED_BRAKE]))
    return dip


def _drag(rng: np.random.Generator, t_s: F64, _v_mps: F64, _start: int) -> F64:
    offset: F64 = float(rng.choice((-DRAG_MPS, DRAG_MPS))) * smooth_step(t_s / EASE_S[Kind.DRAG])
    return offset


def _replay(rng: np.random.Generator, t_s: F64, v_mps: F64, start: int) -> F64:
    lag = min(round(rng.uniform(*REPLAY_LAG_S) / SAMPLE_S), start)
    old, now = v_mps[start - lag : start - lag + len(t_s)], v_mps[start : start + len(t_s)]
    offset: F64 = smooth_step(t_s / EASE_S[Kind.REPLAY]) * (old - now)
    return offset


def _freeze(_rng: np.random.Generator, t_s: F64, v_mps: F64, start: int) -> F64:
    offset: F64 = v_mps[start] - v_mps[start : start + len(t_s)]
    return offset


OFFSETS: Mapping[Kind, Callable[[np.random.Generator, F64, F64, int], F64]] = MappingProxyType(
    {Kind.FEIGNED_BRAKE: _feigned_brake, Kind.DRAG: _drag, Kind.REPLAY: _replay, Kind.FREEZE: _freeze}
)
