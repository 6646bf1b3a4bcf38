"""The default model `headway`: what one vehicle's own readings say of each other, by ten weighed hypotheses.

For each reading: `hypotheses` weighs who lies, `noise_levels` learns the sensors and the driver from readings taken
for healthy, `budget` sets the gate on the log odds (somebody lies : nobody lies), `diagnose` names sensor and kind, and
`relent` ends a suspicion that would not end.
The estimate is the mean over the hypotheses: a sensor taken for a liar has no part in it, the other keeps correcting.

The motion is x' = v at the same instant: a delay belongs to the driver's response to the car ahead (`driver`), which
announces accelerations of whoever is like the driver model. What contradicts the other car is the room `link`'s.
"""

from math import exp, log, sqrt
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from headway.core.estimation.car_following import IdmParams
from headway.core.estimation.imm.driver_input import (
    Driver,
    ask,
    driver_dtype,
    learn_likeness,
    meet,
    unfeel,
    unforeseen_share,
)
from headway.core.estimation.imm.fault_isolation import name_lie, name_past_lie
from headway.core.estimation.imm.fault_timeout import relent
from headway.core.estimation.imm.modes import (
    FINDING,
    HEALTHY,
    HYPOTHESES,
    WEIGHT_FLOOR,
    Hypotheses,
    begin_all,
    estimate,
    judge,
    push,
)
from headway.core.estimation.imm.noise_adaptation import (
    LEVELS,
    Levels,
    begin_levels,
    interrupt,
    learn_levels,
    step_size,
)
from headway.core.estimation.kinematics import LOCATION, SIZE, SPEED, VA, VV, XX, A, V, X
from headway.core.runtime.prefetch import prefetch_row
from headway.core.statistics.alarm_gate import TAIL, Budget, false_alarms_per_hour, gate, learn
from headway.core.types.config import DetectorConfig

TRUSTED = 0.9
"""Probability of HEALTHY above which a reading teaches noise levels;"""
TRUSTED_EARLY = 0.3
"""and before they have settled, when a level too small makes honest readings doubtful and would never be mended."""


def headway_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one vehicle, which remembers the car ahead for `delay_s`."""
    return np.dtype(
        [
            ("count", "i8"),  # readings taken; 0: a row not begun
            ("t_s", "f8"),
            *((name, HYPOTHESES[name]) for name in HYPOTHESES.names or ()),
            ("levels", LEVELS),
            ("tail", TAIL),
            ("slipped_m", "f8"),  # how far the location has moved beside the speed, by slip and lag
            ("a_mps2", "f8"),  # estimate for the time until the next reading
            ("heard_s", "f8"),
            ("relented_s", "f8"),  # event time at which a sensor was last believed again, or the row begun
            ("wrong_s", "f8", (2,)),  # for how long location and speed have been suspected without a break
            ("run", "i8", (2,)),  # anomalous readings in a row, as in `diagnose`
            ("driver", driver_dtype(delay_s)),
        ],
        align=True,
    )


_PLACES: Any = headway_dtype(0.0).fields
RARE_START, RARE_STOP = _PLACES["two"][1], _PLACES["w"][1]
"""Where the bytes of a row lie that only suspicions need."""


class HeadwayParams(NamedTuple):
    """All numbers of the model."""

    hypotheses: Hypotheses
    levels: Levels
    budget: Budget
    wrong_most_s: float
    wrong_share: float
    """A sensor suspected for longer, or for more than this share of the time heard, is believed again (`relent`)."""
    caution: float
    """Added to the gate, times the root of the step that levels still take: that is how uncertain they are."""
    settled_readings: float
    """Readings from which levels must have been learnt before they count as settled, and the tail is learnt."""
    driver: Driver
    max_gap_s: float
    warming_readings: int


def headway_params(config: DetectorConfig) -> HeadwayParams:
    """Return the model's numbers; those of a sensor and a driver are only where the learning starts."""
    return HeadwayParams(
        hypotheses=Hypotheses(
            faults_per_s=0.0012,
            fault_s=1.0,
            manoeuvre=0.003,
            manoeuvre_jerk=90.0,
            manoeuvre_least=1.5,
            standstill_mps=0.6,
            standstill_jump_mps=0.4,
            spread=0.3,
            drift_start=0.1,
            drift_slope=0.3,
            drift_steep=0.1,
            offset_walk=0.005,
            a_std_mps2=2.0,
        ),
        levels=Levels(
            x_std_m=0.02,
            v_std_mps=0.02,
            jerk=0.3,
            walk=1e-4,
            std_least=0.003,
            x_std_most_m=10.0,
            v_std_most_mps=3.0,
            jerk_least=0.001,
            jerk_most=2.0,
            walk_least=3e-6,
            walk_most=10.0,
            wander_least=6.4e-4,
            slowest=0.02,
            settling=0.1,
            sign_step=0.5,
            sign_slowest=0.005,
            sign_share=0.5,
            walk_seen=0.5,
            walk_fade=0.01,
            slip_early=0.02,
            lag_early=0.002,
            slip_gain=0.001,
            slip_most_mps=2.0,
            lag_most_s=0.3,
        ),
        budget=Budget(
            alarms_per_hour=config.alarm_budget_per_hour,
            level=-6.0,
            span=4.0,
            prior_mean=1.0,
            prior_rate_per_hour=200.0,
            prior_peaks=100.0,
            hush_s=1.0,
            memory_s=900.0,
        ),
        wrong_most_s=2.5,
        wrong_share=0.5,
        caution=28.0,
        settled_readings=100.0,
        driver=Driver(
            IdmParams(), config.delay_s, change_most_mps2=1.0, doubt=60.0, memory=0.9995, announced_step=0.002
        ),
        max_gap_s=config.max_gap_s,
        warming_readings=config.warming_readings,
    )


ROOM = np.dtype([("found", FINDING), ("reading", "f8", (2,)), ("mean", "f8", (SIZE,))], align=True)
"""What `step` works in. A record, since slices of an array are counted references, and parts of a record are not."""


@njit(cache=True)
def start(row: Any, z: Any, p: HeadwayParams) -> None:
    """Begin at a reading; sensors, driver and alarm tail that are known stay known."""
    if row.levels.r[LOCATION] == 0.0:
        begin_levels(row.levels, p.levels)
    interrupt(row.levels)
    begin_all(row, z.x_m, z.v_mps, row.levels.r, p.hypotheses)
    meet(row.driver, p.driver)
    row.slipped_m, row.a_mps2 = 0.0, 0.0
    row.wrong_s[:] = 0.0
    row.heard_s = 0.0
    row.relented_s = z.t_s
    row.run[:] = 0
    row.count = 0


@njit(cache=True)
def log_odds(lies: float, honest: float) -> float:
    """Return ln(lies : honest), within the range that weights have."""
    return float(log(max(lies, WEIGHT_FLOOR) / max(honest, WEIGHT_FLOOR)))


@njit(cache=True)
def step(row: Any, z: Any, p: HeadwayParams, verdict: Any, room: Any) -> None:
    """Judge one reading (READING) against one row (`headway_dtype`), in place, and write the VERDICT."""
    levels, driver, w, found, reading, mean = row.levels, row.driver, row.w, room.found, room.reading, room.mean
    nu, cov, ended = found.nu, found.S, found.ended
    unforeseen = 1.0
    dt_s = z.t_s - row.t_s
    row.t_s = z.t_s
    row.slipped_m += (levels.slip + levels.lag_s * row.a_mps2) * dt_s
    if row.count == 0 or dt_s > p.max_gap_s:
        verdict.restarted = row.count > 0
        start(row, z, p)
        dt_s = 0.0
        nu[:], ended[:] = 0.0, 0.0
        cov[0], cov[1], cov[2] = levels.r[LOCATION], 0.0, levels.r[SPEED]
        reading[LOCATION], reading[SPEED] = z.x_m, z.v_mps
    else:
        reading[LOCATION], reading[SPEED] = z.x_m - row.slipped_m, z.v_mps
        unforeseen = unforeseen_share(driver, levels.q)
        verdict.repaired = judge(row, dt_s, reading, levels.r, levels.q, levels.walk, unforeseen, p.hypotheses, found)
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    lies, over_now = 1.0 - w[HEALTHY] if w[HEALTHY] < 0.5 else w[1:].sum(), ended.sum()
    lies_now = log_odds(lies, w[HEALTHY])
    lied_just_now = log_odds(lies + over_now, w[HEALTHY] - over_now)
    verdict.gate = gate(row.tail, p.budget) + p.caution * sqrt(step_size(levels, p.levels) - p.levels.slowest)
    # A lie that is noticed only as it ends is an alarm as well; one that was told of before is simply over.
    late = lies_now <= verdict.gate and row.run[LOCATION] + row.run[SPEED] == 0
    verdict.statistic = lied_just_now if late and lied_just_now > verdict.gate else lies_now
    verdict.anomalous = not verdict.warming and verdict.statistic > verdict.gate
    verdict.p_value = min(1.0, false_alarms_per_hour(row.tail, verdict.statistic, p.budget) * dt_s / 3600.0)
    if verdict.anomalous:
        over = 1.0 - exp(-dt_s / p.hypotheses.fault_s)
        if late:
            ended += w
            verdict.sensor, verdict.kind, verdict.confidence = name_past_lie(ended)
        else:
            verdict.sensor, verdict.kind, verdict.confidence = name_lie(w, row.run, over)
    else:
        row.run[:] = 0

    estimate(row, mean)
    verdict.x_m, verdict.v_mps = mean[X] + row.slipped_m, mean[V]
    verdict.x_std_m, verdict.v_std_mps = sqrt(mean[XX]), sqrt(mean[VV])
    verdict.nu[0], verdict.nu[1] = nu[LOCATION], nu[SPEED]
    verdict.S[0, 0], verdict.S[0, 1], verdict.S[1, 0], verdict.S[1, 1] = cov[0], cov[1], cov[1], cov[2]
    nis = cov[2] * nu[LOCATION] ** 2 - 2.0 * cov[1] * nu[LOCATION] * nu[SPEED] + cov[0] * nu[SPEED] ** 2
    verdict.nis = nis / (cov[0] * cov[2] - cov[1] ** 2)

    if not verdict.warming and levels.learnt > p.settled_readings:
        learn(row.tail, lied_just_now, verdict.anomalous, dt_s, p.budget)
    if dt_s > 0.0 and w[HEALTHY] > (TRUSTED if levels.learnt > p.settled_readings else TRUSTED_EARLY):
        learn_levels(levels, dt_s, row.a_mps2, nu, cov, unforeseen, p.levels)
        k_v, k_a = row.one[VV, HEALTHY] / levels.r[SPEED], row.one[VA, HEALTHY] / levels.r[SPEED]
        learn_likeness(driver, dt_s, nu[SPEED], cov[2], k_v, k_a, p.driver)
    else:
        interrupt(levels)
        unfeel(driver)
    if relent(row, mean, reading, dt_s, p):
        verdict.restarted = True
    change_mps2 = ask(driver, z, dt_s, verdict.x_m, verdict.v_mps, p.driver)
    push(row, change_mps2)
    row.a_mps2 = mean[A] + change_mps2


@njit(cache=True)
def step_row(row: Any, z: Any, p: HeadwayParams, verdict: Any) -> None:
    """Judge one reading against one row."""
    room = np.zeros(1, ROOM)
    for place in range(room.size):  # a record does not keep its array alive, a loop over it does
        step(row, z, p, verdict, room[place])


@njit(cache=True)
def step_batch(bank: Any, rows: Any, readings: Any, p: HeadwayParams, verdicts: Any) -> None:
    """`step_row` for each of the distinct `rows` (B,), with `readings` and `verdicts` (B,): one call for a batch."""
    room = np.zeros(1, ROOM)
    for i in range(rows.size):
        if i + 1 < rows.size:
            prefetch_row(bank, rows[i + 1], 0, RARE_START)
            prefetch_row(bank, rows[i + 1], RARE_STOP, bank.itemsize)
        step(bank[rows[i]], readings[i], p, verdicts[i], room[0])
