"""The mode table: which sensor is at fault in which way, and how modes follow each other.

A mode is a pair of faults, one of the position and one of the speed. Three concern a single sensor, which is left out
or corrected while the other sensor is used:

    BIAS     the reading is off by a constant; the offset is part of the state
    DRIFT    the reading is off by a straight line in time; offset and slope are part of the state
    NOISE    the reading holds no information; each one is off by another amount

With two faults, one sensor has NOISE and the other an OFFSET (a former BIAS or DRIFT, no longer distinguished), or both
have NOISE. Modes form a Markov chain. In an interval a healthy sensor becomes faulty with probability f and a faulty
one healthy with probability e, independently of the other sensor:

    p(source -> target) = share x f^begun x e^ended x (1 - e)^kept

`share` divides f among the kinds of fault, and is written in MODE_TABLE. The exponents follow from the two pairs of
faults. All index tuples below are read off the table when this module is imported.
"""

from enum import IntEnum, unique
from typing import Any, NamedTuple

from numba import njit

from headway.core.estimation.kinematics import NO_COLUMN, Z_POSITION, Z_SPEED, Roles


@unique
class Fault(IntEnum):
    """What is wrong with one sensor in a mode."""

    NONE = 0
    BIAS = 1
    DRIFT = 2
    NOISE = 3
    OFFSET = 4

    @property
    def has_offset(self) -> bool:
        """Whether the sensor's offset is part of the state."""
        return self in (Fault.BIAS, Fault.DRIFT, Fault.OFFSET)


@unique
class Mode(IntEnum):
    """A hypothesis about both sensors; the value is the index of its probability."""

    HEALTHY = 0
    POSITION_BIAS = 1
    POSITION_DRIFT = 2
    POSITION_NOISE = 3
    SPEED_BIAS = 4
    SPEED_DRIFT = 5
    SPEED_NOISE = 6
    POSITION_OFFSET = 7
    SPEED_OFFSET = 8
    BOTH_NOISE = 9


class ModeRow(NamedTuple):
    """One mode: its faults by index of z, and the shares of the modes that may follow it, itself and HEALTHY aside."""

    faults: tuple[Fault, Fault]
    next_shares: dict[Mode, float]


_NONE, _BIAS, _DRIFT, _NOISE, _OFFSET = Fault
_KINDS = 3
"""A fault begins as bias, drift or noise alike."""

MODE_TABLE: dict[Mode, ModeRow] = {
    Mode.HEALTHY: ModeRow(
        (_NONE, _NONE),
        {**{Mode(j): 1.0 / _KINDS for j in range(1, 1 + 2 * _KINDS)}, Mode.BOTH_NOISE: 1.0},
    ),
    Mode.POSITION_BIAS: ModeRow((_BIAS, _NONE), {Mode.POSITION_OFFSET: 1.0}),
    Mode.POSITION_DRIFT: ModeRow((_DRIFT, _NONE), {Mode.POSITION_OFFSET: 1.0}),
    Mode.POSITION_NOISE: ModeRow((_NOISE, _NONE), {Mode.SPEED_OFFSET: 0.5, Mode.BOTH_NOISE: 0.5}),
    Mode.SPEED_BIAS: ModeRow((_NONE, _BIAS), {Mode.SPEED_OFFSET: 1.0}),
    Mode.SPEED_DRIFT: ModeRow((_NONE, _DRIFT), {Mode.SPEED_OFFSET: 1.0}),
    Mode.SPEED_NOISE: ModeRow((_NONE, _NOISE), {Mode.POSITION_OFFSET: 0.5, Mode.BOTH_NOISE: 0.5}),
    Mode.POSITION_OFFSET: ModeRow((_OFFSET, _NOISE), {Mode.POSITION_DRIFT: 1.0, Mode.SPEED_NOISE: 1.0}),
    Mode.SPEED_OFFSET: ModeRow((_NOISE, _OFFSET), {Mode.SPEED_DRIFT: 1.0, Mode.POSITION_NOISE: 1.0}),
    Mode.BOTH_NOISE: ModeRow((_NOISE, _NOISE), {Mode.POSITION_NOISE: 1.0, Mode.SPEED_NOISE: 1.0}),
}

MODE_COUNT = len(MODE_TABLE)
SINGLE_FAULT_MODES = sum(_NONE in row.faults for row in MODE_TABLE.values())
"""Modes below this index have at most one fault."""
HEALTHY, BOTH_NOISE = int(Mode.HEALTHY), int(Mode.BOTH_NOISE)


def _by_sensor(fault: Fault, other: Fault) -> tuple[int, int]:
    """Return, by index of z, the mode in which that sensor has `fault` and the other one `other`."""
    index = {row.faults: int(mode) for mode, row in MODE_TABLE.items()}
    return index[fault, other], index[other, fault]


BIAS, DRIFT, NOISE = (_by_sensor(fault, _NONE) for fault in (_BIAS, _DRIFT, _NOISE))
"""By index of z: the mode in which only that sensor has the fault."""
OFFSET_BESIDE_NOISE, NOISE_BESIDE_OFFSET = _by_sensor(_OFFSET, _NOISE), _by_sensor(_NOISE, _OFFSET)
"""By index of z: the mode with two faults in which that sensor has the first one of the name."""
SINGLE_FAULTS = tuple(zip(BIAS, DRIFT, NOISE, strict=True))
"""By index of z: the modes in which only that sensor is faulty."""
POSITION_HEALTHY, SPEED_HEALTHY = (
    tuple(int(mode) for mode, row in MODE_TABLE.items() if row.faults[z] is _NONE) for z in (Z_POSITION, Z_SPEED)
)
SINGLE_OFFSETS = tuple(
    int(mode) for mode, row in MODE_TABLE.items() if _NONE in row.faults and any(f.has_offset for f in row.faults)
)

SINGLE_COLUMNS = SINGLE_FAULT_MODES + 1
"""Columns of the filters with at most one fault: eight fill the vector registers, and the last one is spare."""
SPARE_COLUMN = SINGLE_FAULT_MODES
DOUBLE_COLUMNS = MODE_COUNT - SINGLE_FAULT_MODES
"""Columns of the filters with two faults; mode j is in column j - SINGLE_FAULT_MODES."""
DOUBLE_OFFSET_COLUMNS = tuple(mode - SINGLE_FAULT_MODES for mode in OFFSET_BESIDE_NOISE)
_BOTH_NOISE_COLUMN = BOTH_NOISE - SINGLE_FAULT_MODES

SINGLE_ROLES: tuple[Roles, ...] = tuple(((NOISE[z], NO_COLUMN), (BIAS[z], DRIFT[z])) for z in (Z_POSITION, Z_SPEED))
"""By index of z, for `update_scalar`: the columns that exclude the reading, and those whose offset is in it."""
ONSET_ROLES: tuple[Roles, ...] = tuple(((BIAS[z], NOISE[z]), (DRIFT[z], NO_COLUMN)) for z in (Z_POSITION, Z_SPEED))
"""The same for a fault that begins: the offset of a bias is set from the reading afterwards (`set_offset`)."""
DOUBLE_ROLES: tuple[Roles, ...] = tuple(
    (
        (NOISE_BESIDE_OFFSET[z] - SINGLE_FAULT_MODES, _BOTH_NOISE_COLUMN),
        (OFFSET_BESIDE_NOISE[z] - SINGLE_FAULT_MODES, NO_COLUMN),
    )
    for z in (Z_POSITION, Z_SPEED)
)
SECOND_BEGINS, BOTH_BEGIN, SECOND_ENDS = range(3)
"""Indices of `Chances.mixing`."""


class Chances(NamedTuple):
    """Probabilities of what may happen to the sensors between two readings."""

    onset: float
    """f: a healthy sensor becomes faulty."""
    end: float
    """e: a faulty sensor becomes healthy."""
    keep_double: float
    """(1 - e)^2: two faults go on."""
    mixing: tuple[float, float, float]
    """(1 - e) f, f^2, e (1 - e): by SECOND_BEGINS, BOTH_BEGIN, SECOND_ENDS."""


@njit(cache=True, error_model="numpy")
def transition_chances(onset: float, end: float) -> Chances:
    """Return the products of f = `begin` and e = `end` that the chain needs."""
    keep = 1.0 - end
    return Chances(onset, end, keep**2, (keep * onset, onset**2, end * keep))


class Transition(NamedTuple):
    """One way of the chain from `source` to `target` that is mixed before a reading."""

    target: int
    source: int
    share: float
    chance: int
    """Index of `Chances.mixing`."""
    offset: bool
    """A second fault: a new offset begins in `target`. A fault that ends: the offset of `source` goes on."""


def _transitions() -> list[Transition]:
    """Return the ways between modes that both differ from HEALTHY, and from HEALTHY to two faults at once."""
    found = []
    for source, row in MODE_TABLE.items():
        for target, share in row.next_shares.items():
            before, after = row.faults, MODE_TABLE[target].faults
            had, has = (any(fault.has_offset for fault in faults) for faults in (before, after))
            begun = sum(old is _NONE and new is not _NONE for old, new in zip(before, after, strict=True))
            if _NONE not in after:
                chance = BOTH_BEGIN if begun == len(after) else SECOND_BEGINS
                found.append(Transition(int(target), int(source), share, chance, has and not had))
            elif source is not Mode.HEALTHY:
                found.append(Transition(int(target), int(source), share, SECOND_ENDS, has))
    return sorted(found, key=lambda way: (way.target, way.offset, way.source))


SECOND_FAULT_BEGINS: Any = tuple(way for way in _transitions() if way.target >= SINGLE_FAULT_MODES)
"""Ways into modes with two faults."""
SECOND_FAULT_ENDS: Any = tuple(way for way in _transitions() if way.target < SINGLE_FAULT_MODES)
"""Ways out of them into modes with one."""


@njit(cache=True, error_model="numpy")
def sensor_fault_probability(mode_probability: Any) -> tuple[float, float]:
    """Return the probabilities that the position and that the speed is faulty."""
    two = mode_probability[SINGLE_FAULT_MODES:].sum()
    position, speed = 0.0, 0.0
    for j in SINGLE_FAULTS[Z_POSITION]:
        position += mode_probability[j]
    for j in SINGLE_FAULTS[Z_SPEED]:
        speed += mode_probability[j]
    return position + two, speed + two
