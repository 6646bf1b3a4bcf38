"""No sensor is suspected for ever: after a while it is believed again, and what was learnt of it is doubted.

An offset of the location that does not end cannot be told from an estimate that has gone astray, and noise that does
not end is simply the sensor's. So a suspicion ends with the suspect's own reading taken for true. When that happens
again soon, or to a vehicle not known well yet, the levels in `noise_levels` were wrong, and are moved by a large step.
"""

from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import BIAS, BOTH, DRIFT, NOISE, OTHER_SENSOR, PAIR, give_in, suspicion
from headway.core.estimation.imm.noise_adaptation import bounded, shift
from headway.core.estimation.kinematics import LOCATION, SPEED, S

LOUDER = 16.0
"""Factor on the variance of a sensor whose noise does not end, or on the walk of a location whose offset does not."""
WALKING = 1e-3
"""Least walk (m^2/s) after such a step: a location wanders by a centimetre a reading, or not at all."""
SHIFT_MPS = 1.0
"""Most that the slip changes at such a step."""
AGAIN_S = 30.0
"""A sensor believed again twice within this time, or so early, is not what it is taken for."""
RESETTLE = 20.0
"""Readings learnt that are left after such a step, so that the level is found anew soon."""


@njit(cache=True)
def doubt_levels(row: Any, sensor: int, p: Any) -> None:
    """Blame a suspicion of `sensor` that comes back and back on what was learnt: noise, scale of the speed, walk."""
    w, own = row.w, OTHER_SENSOR * sensor
    if w[NOISE + own] + w[PAIR + 1 - sensor] + w[BOTH] > 0.5:
        most = p.levels.x_std_most_m if sensor == LOCATION else p.levels.v_std_most_mps
        row.levels.r[sensor] = min(LOUDER * row.levels.r[sensor], most**2)
    elif sensor == LOCATION:
        if w[DRIFT] > w[BIAS]:
            shift(row.levels, bounded(row.one[S, DRIFT], -SHIFT_MPS, SHIFT_MPS), p.levels)
        else:
            row.levels.walk = bounded(LOUDER * row.levels.walk, WALKING, p.levels.walk_most)


@njit(cache=True)
def relent(row: Any, mean: Any, reading: Any, dt_s: float, p: Any) -> bool:
    """Count how long each sensor has been suspected, and believe it again when that is too long; return whether so."""
    wrong_x, wrong_v = suspicion(row.w)
    row.wrong_s[LOCATION] = row.wrong_s[LOCATION] + dt_s if wrong_x > 0.5 else 0.0
    row.wrong_s[SPEED] = row.wrong_s[SPEED] + dt_s if wrong_v > 0.5 else 0.0
    row.heard_s += dt_s
    most_s = min(p.wrong_most_s, p.wrong_share * row.heard_s)
    x, v = row.wrong_s[LOCATION] > most_s, row.wrong_s[SPEED] > most_s
    if not (x or v):
        return False
    again = row.t_s - row.relented_s < AGAIN_S
    row.relented_s = row.t_s
    for sensor in (LOCATION, SPEED):
        if row.wrong_s[sensor] > most_s:
            row.wrong_s[sensor] = 0.0
            if again:
                row.levels.learnt = min(row.levels.learnt, RESETTLE)
                doubt_levels(row, sensor, p)
    give_in(row, x, v, mean, reading, row.levels.r, p.hypotheses)
    return True
