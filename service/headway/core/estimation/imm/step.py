"""The default model `headway`: what one vehicle's own readings say of each other, by ten weighed hypotheses.

For each reading: `modes` weighs who lies, `noise_levels` learns the sensors and the driver from readings taken
for healthy, `budget` sets the gate on the log odds (somebody lies : nobody lies), `diagnose` names sensor and kind, and
`fault_timeout` ends a suspicion that would not end.
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
    DriverParams,
    adapt_response_gain,
    driver_dtype,
    predict_acceleration,
    reset_sensitivity,
    set_leader,
    unexplained_share,
)
from headway.core.estimation.imm.fault_isolation import isolate, isolate_ended
from headway.core.estimation.imm.fault_timeout import fault_timeout
from headway.core.estimation.imm.modes import (
    HEALTHY,
    IMM_WORKSPACE,
    MODE_PROBABILITY_FLOOR,
    MODES,
    ModeParams,
    add_acceleration_change,
    estimate,
    initialise_modes,
    update,
)
from headway.core.estimation.imm.noise_adaptation import (
    ADAPTED_NOISE,
    NoiseAdaptationParams,
    adapt_noise,
    initialise_noise,
    reset_previous_innovation,
    step_size,
)
from headway.core.estimation.kinematics import AX, PX, SIZE, VA, VV, VX, XX, Z_POSITION, Z_SPEED
from headway.core.runtime.prefetch import prefetch_row
from headway.core.statistics.alarm_gate import TAIL, Budget, false_alarms_per_hour, gate, learn
from headway.core.types.config import DetectorConfig

ADAPT_ABOVE = 0.9
"""Probability of HEALTHY above which a reading teaches noise levels;"""
ADAPT_ABOVE_EARLY = 0.3
"""and before they have settled, when a level too small makes honest readings doubtful and would never be mended."""


def headway_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one vehicle, which remembers the car ahead for `delay_s`."""
    return np.dtype(
        [
            ("count", "i8"),  # readings taken; 0: a row not begun
            ("t_s", "f8"),
            *((name, MODES[name]) for name in MODES.names or ()),
            ("noise", ADAPTED_NOISE),
            ("tail", TAIL),
            ("accumulated_bias_m", "f8"),  # how far the location has moved beside the speed, by slip and lag
            ("a_mps2", "f8"),  # estimate for the time until the next reading
            ("observed_s", "f8"),
            ("last_reset_s", "f8"),  # event time at which a sensor was last believed again, or the row begun
            ("fault_time_s", "f8", (2,)),  # for how long location and speed have been suspected without a break
            ("run_length", "i8", (2,)),  # anomalous readings in a row, as in `diagnose`
            ("driver", driver_dtype(delay_s)),
        ],
        align=True,
    )


_FIELDS: Any = headway_dtype(0.0).fields
DOUBLES_START, DOUBLES_STOP = _FIELDS["double"][1], _FIELDS["mode_probability"][1]
"""Where the bytes of a row lie that only suspicions need."""


class HeadwayParams(NamedTuple):
    """All numbers of the model."""

    modes: ModeParams
    noise: NoiseAdaptationParams
    budget: Budget
    fault_time_max_s: float
    fault_share_max: float
    """A sensor faulty for longer, or for more than this share of the time observed, is reset (`fault_timeout`)."""
    gate_margin: float
    """Added to the gate, times the root of the step that levels still take: that is how uncertain they are."""
    settled_readings: float
    """Readings from which levels must have been learnt before they count as settled, and the tail is learnt."""
    driver: DriverParams
    max_gap_s: float
    warming_readings: int


def headway_params(config: DetectorConfig) -> HeadwayParams:
    """Return the model's numbers; those of a sensor and a driver are only where the learning starts."""
    return HeadwayParams(
        modes=ModeParams(
            faults_per_s=0.0012,
            fault_s=1.0,
            manoeuvre=0.003,
            manoeuvre_jerk=90.0,
            manoeuvre_jerk_min=1.5,
            standstill_mps=0.6,
            standstill_jump_mps=0.4,
            fault_size=0.3,
            drift_offset0=0.1,
            drift_slope0=0.3,
            drift_slope_share=0.1,
            offset_noise=0.005,
            a_std_mps2=2.0,
        ),
        noise=NoiseAdaptationParams(
            x_std_m=0.02,
            v_std_mps=0.02,
            jerk_density=0.3,
            random_walk_density=1e-4,
            std_min=0.003,
            x_std_max_m=10.0,
            v_std_max_mps=3.0,
            jerk_density_min=0.001,
            jerk_density_max=2.0,
            random_walk_min=3e-6,
            random_walk_max=10.0,
            position_noise_floor=6.4e-4,
            step_min=0.02,
            settling=0.1,
            sign_step=0.5,
            sign_step_min=0.005,
            sign_share=0.5,
            random_walk_observable=0.5,
            random_walk_decay=0.01,
            speed_bias_var0=0.02,
            speed_latency_var0=0.002,
            bias_latency_gain=0.001,
            speed_bias_max_mps=2.0,
            speed_latency_max_s=0.3,
        ),
        budget=Budget(
            alarms_per_hour=config.alarm_budget_per_hour,
            threshold=-6.0,
            truncation=4.0,
            prior_mean=1.0,
            prior_rate_per_hour=200.0,
            prior_exceedances=100.0,
            holdoff_s=1.0,
            memory_s=900.0,
        ),
        fault_time_max_s=2.5,
        fault_share_max=0.5,
        gate_margin=28.0,
        settled_readings=100.0,
        driver=DriverParams(
            IdmParams(),
            config.delay_s,
            accel_change_max_mps2=1.0,
            prior_information=60.0,
            forgetting_factor=0.9995,
            explained_step=0.002,
        ),
        max_gap_s=config.max_gap_s,
        warming_readings=config.warming_readings,
    )


WORKSPACE = np.dtype([("found", IMM_WORKSPACE), ("reading", "f8", (2,)), ("mean", "f8", (SIZE,))], align=True)
"""What `step` works in. A record, since slices of an array are counted references, and parts of a record are not."""


@njit(cache=True, error_model="numpy")
def initialise(row: Any, z: Any, p: HeadwayParams) -> None:
    """Begin at a reading; sensors, driver and alarm tail that are known stay known."""
    if row.noise.r[Z_POSITION] == 0.0:
        initialise_noise(row.noise, p.noise)
    reset_previous_innovation(row.noise)
    initialise_modes(row, z.x_m, z.v_mps, row.noise.r, p.modes)
    set_leader(row.driver, p.driver)
    row.accumulated_bias_m, row.a_mps2 = 0.0, 0.0
    row.fault_time_s[:] = 0.0
    row.observed_s = 0.0
    row.last_reset_s = z.t_s
    row.run_length[:] = 0
    row.count = 0


@njit(cache=True, error_model="numpy")
def log_odds(fault_probability: float, healthy_probability: float) -> float:
    """Return ln(lies : honest), within the range that weights have."""
    return float(log(max(fault_probability, MODE_PROBABILITY_FLOOR) / max(healthy_probability, MODE_PROBABILITY_FLOOR)))


@njit(cache=True, error_model="numpy")
def step(row: Any, z: Any, p: HeadwayParams, verdict: Any, workspace: Any) -> None:
    """Judge one reading (READING) against one row (`headway_dtype`), in place, and write the VERDICT."""
    noise, driver, mode_probability, found, reading, mean = (
        row.noise,
        row.driver,
        row.mode_probability,
        workspace.found,
        workspace.reading,
        workspace.mean,
    )
    nu, cov, ended_probability = found.nu, found.S, found.ended_probability
    unexplained = 1.0
    dt_s = z.t_s - row.t_s
    row.t_s = z.t_s
    row.accumulated_bias_m += (noise.speed_bias_mps + noise.speed_latency_s * row.a_mps2) * dt_s
    if row.count == 0 or dt_s > p.max_gap_s:
        verdict.restarted = row.count > 0
        initialise(row, z, p)
        dt_s = 0.0
        nu[:], ended_probability[:], found.nis = 0.0, 0.0, 0.0
        cov[0], cov[1], cov[2] = noise.r[Z_POSITION], 0.0, noise.r[Z_SPEED]
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m, z.v_mps
    else:
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m - row.accumulated_bias_m, z.v_mps
        unexplained = unexplained_share(driver, noise.jerk_density)
        verdict.repaired = update(
            row,
            dt_s,
            reading,
            noise.r,
            noise.jerk_density,
            noise.random_walk_density,
            unexplained,
            verdict.implausible,
            p.modes,
            found,
        )
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    fault_probability, recovered_probability = (
        1.0 - mode_probability[HEALTHY] if mode_probability[HEALTHY] < 0.5 else mode_probability[1:].sum(),
        ended_probability.sum(),
    )
    fault_log_odds = log_odds(fault_probability, mode_probability[HEALTHY])
    recent_fault_log_odds = log_odds(
        fault_probability + recovered_probability, mode_probability[HEALTHY] - recovered_probability
    )
    verdict.gate = gate(row.tail, p.budget) + p.gate_margin * sqrt(step_size(noise, p.noise) - p.noise.step_min)
    # A lie that is noticed only as it ends is an alarm as well; one that was told of before is simply over.
    ended_unreported = fault_log_odds <= verdict.gate and row.run_length[Z_POSITION] + row.run_length[Z_SPEED] == 0
    verdict.statistic = (
        recent_fault_log_odds if ended_unreported and recent_fault_log_odds > verdict.gate else fault_log_odds
    )
    verdict.anomalous = not verdict.warming and verdict.statistic > verdict.gate
    verdict.p_value = min(1.0, false_alarms_per_hour(row.tail, verdict.statistic, p.budget) * dt_s / 3600.0)
    if verdict.anomalous:
        over = 1.0 - exp(-dt_s / p.modes.fault_s)
        if ended_unreported:
            ended_probability += mode_probability
            verdict.sensor, verdict.kind, verdict.confidence = isolate_ended(ended_probability)
        else:
            verdict.sensor, verdict.kind, verdict.confidence = isolate(mode_probability, row.run_length, over)
    else:
        row.run_length[:] = 0

    estimate(row, mean)
    verdict.x_m, verdict.v_mps = mean[PX] + row.accumulated_bias_m, mean[VX]
    verdict.x_std_m, verdict.v_std_mps = sqrt(mean[XX]), sqrt(mean[VV])
    verdict.nu[0], verdict.nu[1] = nu[Z_POSITION], nu[Z_SPEED]
    verdict.S[0, 0], verdict.S[0, 1], verdict.S[1, 0], verdict.S[1, 1] = cov[0], cov[1], cov[1], cov[2]
    verdict.nis = found.nis

    if not verdict.warming and noise.adapted_readings > p.settled_readings:
        learn(row.tail, recent_fault_log_odds, verdict.anomalous, dt_s, p.budget)
    if dt_s > 0.0 and mode_probability[HEALTHY] > (
        ADAPT_ABOVE if noise.adapted_readings > p.settled_readings else ADAPT_ABOVE_EARLY
    ):
        adapt_noise(noise, dt_s, row.a_mps2, nu, cov, unexplained, p.noise)
        k_v, k_a = row.single[VV, HEALTHY] / noise.r[Z_SPEED], row.single[VA, HEALTHY] / noise.r[Z_SPEED]
        adapt_response_gain(driver, dt_s, nu[Z_SPEED], cov[2], k_v, k_a, p.driver)
    else:
        reset_previous_innovation(noise)
        reset_sensitivity(driver)
    if verdict.implausible == 0 and fault_timeout(row, mean, reading, dt_s, p):
        verdict.restarted = True
    change_mps2 = predict_acceleration(driver, z, dt_s, verdict.x_m, verdict.v_mps, p.driver)
    add_acceleration_change(row, change_mps2)
    row.a_mps2 = mean[AX] + change_mps2


@njit(cache=True, error_model="numpy")
def step_row(row: Any, z: Any, p: HeadwayParams, verdict: Any) -> None:
    """Judge one reading against one row."""
    workspace = np.zeros(1, WORKSPACE)
    for place in range(workspace.size):  # a record does not keep its array alive, a loop over it does
        step(row, z, p, verdict, workspace[place])


@njit(cache=True, error_model="numpy")
def step_batch(bank: Any, rows: Any, readings: Any, p: HeadwayParams, verdicts: Any) -> None:
    """`step_row` for each of the distinct `rows` (B,), with `readings` and `verdicts` (B,): one call for a batch."""
    workspace = np.zeros(1, WORKSPACE)
    for i in range(rows.size):
        if i + 1 < rows.size:
            prefetch_row(bank, rows[i + 1], 0, DOUBLES_START)
            prefetch_row(bank, rows[i + 1], DOUBLES_STOP, bank.itemsize)
        step(bank[rows[i]], readings[i], p, verdicts[i], workspace[0])
