"""The attacks of F2MD and VeReMi-NextGen on recorded or simulated vehicles, with their published parameters.

An attack replaces the messages of one vehicle from its onset on. `malicious` marks the messages that differ from the
truth enough to matter, by the rules of VeReMi-NextGen: a zero speed of a car that stands is no attack.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from headway_loadtest.evaluate.field.gnss import shift
from headway_loadtest.evaluate.field.recordings import Records, local_m, move
from headway_loadtest.sources.drive import F64

Bools = NDArray[np.bool_]
PLAYGROUND_M = 850.0
"""False positions lie within so much of the vehicle, in each direction."""
OFFSET_M = (20.0, 70.0)
SPEED_MOST_MPS = 40.0
OFFSET_MPS = (1.0, 7.0)
CONSTANT_OFFSET_MPS = 5.0
MIRROR_M = (6.0, 14.0)
TRIGGER = 0.05
"""Probability of a message to begin a sudden attack."""
EFFECT_MPS, EFFECT_M = 1.0, 20.0
"""Least change of speed, or of position, that counts as malicious."""
DELAY_S = (2.0, 4.0)
REPLAY_MESSAGES, REPLAY_WITHIN_S, REPLAY_WITHIN_M = (4, 8), 5.0, 400.0
DISRUPTIVE_S = 10.0
DOS_COPIES = (2, 4)
DOS_RATE = 4
SYBILS = (4, 6)
SYBIL_IDS = 5
ACCEL_FACTOR = (2.0, 4.0)


@dataclass(frozen=True, slots=True)
class Context:
    """What an attacker knows beside its own messages."""

    rng: np.random.Generator
    others: Records
    """Messages of every other vehicle of the recording, by event time."""


@dataclass(frozen=True, slots=True)
class Forged:
    """Messages that replace those of a vehicle. `pseudonym` (n,) is 0 for its own id, else the number of another."""

    messages: Records
    malicious: Bools
    pseudonym: NDArray[np.int64]


Attack = Callable[[Context, Records], Forged]
"""Takes the true messages from the onset on; the array may be changed in place."""


def _same_id(messages: Records, malicious: Bools) -> Forged:
    return Forged(messages, malicious, np.zeros(len(messages), np.int64))


def _all(messages: Records) -> Forged:
    return _same_id(messages, np.ones(len(messages), np.bool_))


def _either_sign(rng: np.random.Generator, span: tuple[float, float], n: int) -> F64:
    signed: F64 = rng.uniform(*span, n) * rng.choice((-1.0, 1.0), n)
    return signed


def _position(each: bool, offset: bool) -> Attack:
    """Report a false position: drawn for each message or once; an offset, or a place in the surroundings."""

    def attack(context: Context, messages: Records) -> Forged:
        n = len(messages)
        draws = n if each else 1
        if offset:
            north, east = (_either_sign(context.rng, OFFSET_M, draws) for _ in range(2))
        else:
            north, east = (context.rng.uniform(-PLAYGROUND_M, PLAYGROUND_M, draws) for _ in range(2))
            messages["lat_deg"], messages["lon_deg"] = messages["lat_deg"][0], messages["lon_deg"][0]
        shift(messages, np.broadcast_to(north, n), np.broadcast_to(east, n))
        return _all(messages)

    return attack


def _mirror(context: Context, messages: Records) -> Forged:
    move(messages, 0.0, -context.rng.uniform(*MIRROR_M))
    return _all(messages)


def _speed(values: Callable[[np.random.Generator, F64], F64]) -> Attack:
    """Report a false speed, not below 0; it is malicious where it is off by `EFFECT_MPS`."""

    def attack(context: Context, messages: Records) -> Forged:
        true = messages["speed_mps"].copy()
        messages["speed_mps"] = np.maximum(values(context.rng, true), 0.0)
        return _same_id(messages, np.abs(messages["speed_mps"] - true) >= EFFECT_MPS)

    return attack


def _triggered(rng: np.random.Generator, n: int) -> int:
    return min(int(rng.geometric(TRIGGER)) - 1, n - 1)


def _hold_speed(rng: np.random.Generator, true: F64) -> F64:
    at = _triggered(rng, len(true))
    return np.where(np.arange(len(true)) >= at, true[at], true)


def _sudden_stop(context: Context, messages: Records) -> Forged:
    at = _triggered(context.rng, len(messages))
    after = np.arange(len(messages)) >= at
    north, east = local_m(messages, float(messages["lat_deg"][at]), float(messages["lon_deg"][at]))
    matters = (messages["speed_mps"] > EFFECT_MPS) | (np.hypot(north, east) >= EFFECT_M)
    for name in ("lat_deg", "lon_deg", "heading_deg"):
        messages[name][at:] = messages[name][at]
    messages["speed_mps"][at:] = 0.0
    return _same_id(messages, after & matters)


def _reverse_heading(_context: Context, messages: Records) -> Forged:
    messages["heading_deg"] = (messages["heading_deg"] + 180.0) % 360.0
    return _same_id(messages, (messages["speed_mps"] > EFFECT_MPS) & np.isfinite(messages["heading_deg"]))


def _delay(context: Context, messages: Records) -> Forged:
    delay_us = round(context.rng.uniform(*DELAY_S) * 1e6)
    messages["t_us"] += delay_us
    messages["received_us"] += delay_us
    return _all(messages)


def _take(messages: Records, at: NDArray[np.int64], source: Records, chosen: NDArray[np.int64]) -> None:
    """Copy the readings of other messages into one's own."""
    for name in ("lat_deg", "lon_deg", "speed_mps", "heading_deg", "accel_mps2"):
        messages[name][at] = source[name][chosen]


def _replay(context: Context, messages: Records) -> Forged:
    """Replay some messages of a vehicle nearby, one after the other, then those of another."""
    rng, others = context.rng, context.others
    malicious = np.zeros(len(messages), np.bool_)
    k = 0
    while k < len(messages):
        length = int(rng.integers(*REPLAY_MESSAGES, endpoint=True))
        t_us = messages["t_us"][k]
        recent = slice(*np.searchsorted(others["t_us"], [t_us - REPLAY_WITHIN_S * 1e6, t_us]))
        north, east = local_m(others[recent], float(messages["lat_deg"][k]), float(messages["lon_deg"][k]))
        near = np.flatnonzero(np.hypot(north, east) < REPLAY_WITHIN_M) + recent.start
        if near.size:
            first = int(rng.choice(near))
            of_victim = first + np.flatnonzero(others["vehicle"][first:] == others["vehicle"][first])[:length]
            at = np.arange(k, min(k + of_victim.size, len(messages)))
            _take(messages, at, others, of_victim[: at.size])
            malicious[at] = True
        k += length
    return _same_id(messages, malicious)


def _disrupt(context: Context, messages: Records) -> Forged:
    """Replay a message of anybody for each of one's own."""
    others = context.others
    malicious = np.zeros(len(messages), np.bool_)
    first = np.searchsorted(others["t_us"], messages["t_us"] - DISRUPTIVE_S * 1e6)
    last = np.searchsorted(others["t_us"], messages["t_us"])
    at = np.flatnonzero(last > first)
    if at.size:
        chosen = first[at] + np.floor(context.rng.random(at.size) * (last - first)[at]).astype(np.int64)
        _take(messages, at, others, chosen)
        malicious[at] = True
    return _same_id(messages, malicious)


def _flooded(messages: Records, rate: int) -> Records:
    """Return each message `rate` times, the copies evenly between it and the next."""
    gaps_us = np.diff(messages["t_us"], append=messages["t_us"][-1] + 100_000)
    copies = np.repeat(messages, rate)
    later_us = np.repeat(gaps_us, rate) * np.tile(np.arange(rate), len(messages)) // rate
    copies["t_us"] += later_us
    copies["received_us"] += later_us
    return copies


def _dos(context: Context, messages: Records) -> Forged:
    return _all(_flooded(messages, int(context.rng.integers(*DOS_COPIES, endpoint=True))))


def _dos_random(context: Context, messages: Records) -> Forged:
    flood = _position(each=True, offset=False)(context, _flooded(messages, DOS_RATE)).messages
    flood["speed_mps"] = context.rng.uniform(0.0, SPEED_MOST_MPS, len(flood))
    return _all(flood)


def _dos_disruptive(context: Context, messages: Records) -> Forged:
    flood = _disrupt(context, _flooded(messages, DOS_RATE)).messages
    return _all(flood)


def _dos_random_sybil(context: Context, messages: Records) -> Forged:
    """Flood with random readings under pseudonyms in turn."""
    flood = _dos_random(context, messages).messages
    return Forged(flood, np.ones(len(flood), np.bool_), 1 + np.arange(len(flood)) % SYBIL_IDS)


def _congestion_sybil(context: Context, messages: Records) -> Forged:
    """Add phantoms around the vehicle that drive as it does; its own messages stay true."""
    rng, n = context.rng, len(messages)
    phantoms = []
    for _ in range(int(rng.integers(*SYBILS, endpoint=True))):
        phantom = messages.copy()
        move(
            phantom,
            _either_sign(rng, (5.0, 6.0), 1)[0] + rng.uniform(-2.0, 2.0),
            _either_sign(rng, (2.0, 3.0), 1)[0],
        )
        phantom["speed_mps"] *= rng.uniform(0.95, 1.05)
        phantoms.append(phantom)
    pseudonym = np.repeat(np.arange(len(phantoms) + 1), n)
    return Forged(np.concatenate([messages, *phantoms]), pseudonym > 0, pseudonym)


def _acceleration(sign: float, least_mps2: float) -> Attack:
    """Multiply the reported acceleration; position and speed stay true."""

    def attack(context: Context, messages: Records) -> Forged:
        true = messages["accel_mps2"].copy()
        factor = sign * context.rng.uniform(*ACCEL_FACTOR)
        forged = true > least_mps2 if sign < 0.0 else np.abs(true) > least_mps2
        messages["accel_mps2"] = np.where(forged, factor * true, true)
        return _same_id(messages, forged)

    return attack


ATTACKS: Mapping[str, Attack] = MappingProxyType(
    {
        "constant-position": _position(each=False, offset=False),
        "random-position": _position(each=True, offset=False),
        "constant-position-offset": _position(each=False, offset=True),
        "random-position-offset": _position(each=True, offset=True),
        "position-mirroring": _mirror,
        "constant-speed": _speed(lambda rng, true: np.full(true.size, rng.uniform(0.0, SPEED_MOST_MPS))),
        "random-speed": _speed(lambda rng, true: rng.uniform(0.0, SPEED_MOST_MPS, true.size)),
        "constant-speed-offset": _speed(lambda rng, true: true + _either_sign(rng, OFFSET_MPS, 1)),
        "speed-offset-5mps": _speed(lambda rng, true: true + CONSTANT_OFFSET_MPS * rng.choice((-1.0, 1.0))),
        "random-speed-offset": _speed(lambda rng, true: true + _either_sign(rng, OFFSET_MPS, true.size)),
        "zero-speed": _speed(lambda _rng, true: np.zeros_like(true)),
        "sudden-constant-speed": _speed(_hold_speed),
        "sudden-stop": _sudden_stop,
        "reversed-heading": _reverse_heading,
        "replay": _replay,
        "disruptive": _disrupt,
        "time-delay": _delay,
        "feigned-braking": _acceleration(-1.0, 0.25),
        "acceleration-multiplication": _acceleration(1.0, 0.5),
        "dos": _dos,
        "dos-random": _dos_random,
        "dos-disruptive": _dos_disruptive,
        "dos-random-sybil": _dos_random_sybil,
        "congestion-sybil": _congestion_sybil,
    }
)

CATCH: Mapping[str, tuple[float, float]] = MappingProxyType(
    {
        "constant-position-offset": (0.80, 0.70),
        "random-position-offset": (0.99, 0.97),
        "constant-speed-offset": (0.51, 0.55),
        "random-speed-offset": (0.74, 0.73),
        "zero-speed": (0.93, 0.93),
        "sudden-constant-speed": (0.53, 0.81),
        "sudden-stop": (0.02, 0.22),
        "reversed-heading": (0.47, 0.51),
        "replay": (0.18, 0.25),
    }
)
"""Message recall published for CaTCH on VeReMi-NextGen, low density, attacks from birth: urban, highway."""
CATCH_FALSE_POSITIVE_RATE = (0.024, 0.12)
