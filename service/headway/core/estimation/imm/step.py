"""The default model `headway`: one vehicle's own position and speed, by ten modes of its sensors.

For each reading:

    update              mode probabilities and filters (`modes`, `state`, `update`)
    adapt_noise         noise of sensors and driver, from healthy readings (`noise_adaptation`)
    gate                threshold of the log odds (fault : healthy), from the alarm budget (`alarm_gate`)
    isolate             sensor and kind (`fault_isolation`)
    fault_timeout       reset of a fault that does not end (`fault_timeout`)

The estimate is the mean over all modes: a faulty sensor has no part in it, and the other sensor keeps correcting it.
The motion is x' = v at the same instant. A delay belongs to the driver's response to the leader (`driver_input`).
Contradictions between two vehicles are tested in `consistency`.
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
    initialise_driver,
    predict_acceleration,
    reset_sensitivity,
    unexplained_share,
)
from headway.core.estimation.imm.fault_isolation import isolate, isolate_ended
from headway.core.estimation.imm.fault_timeout import fault_timeout
from headway.core.estimation.imm.modes import HEALTHY
from headway.core.estimation.imm.noise_adaptation import (
    ADAPTED_NOISE,
    NoiseAdaptationParams,
    adapt_noise,
    initialise_noise,
    reset_previous_innovation,
    step_size,
)
from headway.core.estimation.imm.state import (
    IMM_WORKSPACE,
    MODE_PROBABILITY_FLOOR,
    MODES,
    ModeParams,
    add_acceleration_change,
    estimate,
    initialise_modes,
)
from headway.core.estimation.imm.update import Motion, update
from headway.core.estimation.kinematics import AX, PX, SIZE, VA, VV, VX, XX, Z_POSITION, Z_SPEED
from headway.core.runtime.prefetch import prefetch_row
from headway.core.statistics.alarm_gate import TAIL, Budget, false_alarms_per_hour, gate, learn
from headway.core.types.config import DetectorConfig

ADAPT_ABOVE = 0.9
"""Probability of HEALTHY above which a reading adapts the noise."""
ADAPT_ABOVE_EARLY = 0.3
"""The same until the noise has settled: a variance that starts too small makes healthy readings doubtful (ADR 0006)."""


def headway_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one vehicle, whose ring of inputs reaches back `delay_s`."""
    return np.dtype(
        [
            ("count", "i8"),  # readings; 0: a row that is not initialised
            ("t_s", "f8"),
            *((name, MODES[name]) for name in MODES.names or ()),
            ("noise", ADAPTED_NOISE),
            ("tail", TAIL),
            ("accumulated_bias_m", "f8"),  # integral of speed bias and latency: position less integral of the speed
            ("a_mps2", "f8"),  # estimate for the time until the next reading
            ("observed_s", "f8"),  # time since the row was initialised
            ("last_reset_s", "f8"),  # event time of the last time-out, or of the initialisation
            ("fault_time_s", "f8", (2,)),  # how long position and speed have been faulty without a break
            ("run_length", "i8", (2,)),  # anomalous readings in a row, as in `isolate`
            ("driver", driver_dtype(delay_s)),
        ],
        align=True,
    )


_FIELDS: Any = headway_dtype(0.0).fields
DOUBLES_START, DOUBLES_STOP = _FIELDS["double"][1], _FIELDS["mode_probability"][1]
"""The bytes of a row that only modes with two faults need."""


class HeadwayParams(NamedTuple):
    """All numbers of the model."""

    budget: Budget
    driver: DriverParams
    max_gap_s: float
    """A longer silence initialises the row again, s."""
    warming_readings: int
    modes: ModeParams = ModeParams()
    noise: NoiseAdaptationParams = NoiseAdaptationParams()
    fault_time_max_s: float = 2.5
    """Time-out of a fault, s (ADR 0005: 3.5 s keeps every lock-in for longer)."""
    fault_share_max: float = 0.5
    """A fault times out earlier if it exceeds this share of the time observed."""
    gate_margin: float = 28.0
    """Added to the gate, times the root of the step that the noise still takes beyond its least (ADR 0006)."""
    settled_readings: float = 100.0
    """Adapted readings from which the noise has settled, and the tail of the gate is learnt (ADR 0006)."""


def headway_params(config: DetectorConfig) -> HeadwayParams:
    """Return the model's numbers for the settings of a detector."""
    # Excursions of the log odds on clean readings: ADR 0006.
    budget = Budget(
        alarms_per_hour=config.alarm_budget_per_hour,
        threshold=-6.0,
        truncation=4.0,
        prior_mean=1.0,
        prior_rate_per_hour=200.0,
        prior_exceedances=100.0,
        holdoff_s=1.0,
        memory_s=900.0,
    )
    driver = DriverParams(IdmParams(), config.delay_s)
    return HeadwayParams(budget, driver, config.max_gap_s, config.warming_readings)


WORKSPACE = np.dtype([("imm", IMM_WORKSPACE), ("reading", "f8", (2,)), ("mean", "f8", (SIZE,))], align=True)
"""What `step` works in: a record, because its parts are not counted references as slices of an array are."""


@njit(cache=True, error_model="numpy")
def initialise(row: Any, z: Any, p: HeadwayParams) -> None:
    """Initialise a row at a reading; adapted noise, response gain and alarm tail are kept."""
    if row.noise.r[Z_POSITION] == 0.0:
        initialise_noise(row.noise, p.noise)
    reset_previous_innovation(row.noise)
    initialise_modes(row, z.x_m, z.v_mps, row.noise.r, p.modes)
    initialise_driver(row.driver, p.driver)
    row.accumulated_bias_m, row.a_mps2 = 0.0, 0.0
    row.fault_time_s[:] = 0.0
    row.observed_s = 0.0
    row.last_reset_s = z.t_s
    row.run_length[:] = 0
    row.count = 0


@njit(cache=True, error_model="numpy")
def log_odds(fault_probability: float, healthy_probability: float) -> float:
    """Return ln(fault : healthy), within the range of mode probabilities."""
    return float(log(max(fault_probability, MODE_PROBABILITY_FLOOR) / max(healthy_probability, MODE_PROBABILITY_FLOOR)))


@njit(cache=True, error_model="numpy")
def detect(row: Any, ended_probability: Any, dt_s: float, p: HeadwayParams, verdict: Any) -> float:
    """Write statistic, gate and fault of the VERDICT; return the log odds of a fault now or until this reading."""
    mu, run_length = row.mode_probability, row.run_length
    fault = 1.0 - mu[HEALTHY] if mu[HEALTHY] < 0.5 else mu[1:].sum()
    ended = ended_probability.sum()
    fault_log_odds = log_odds(fault, mu[HEALTHY])
    recent_log_odds = log_odds(fault + ended, mu[HEALTHY] - ended)
    verdict.gate = gate(row.tail, p.budget) + p.gate_margin * sqrt(step_size(row.noise, p.noise) - p.noise.step_min)
    # A fault that is detected only as it ends is an alarm as well; one that was reported before has simply ended.
    unreported = fault_log_odds <= verdict.gate and run_length[Z_POSITION] + run_length[Z_SPEED] == 0
    verdict.statistic = recent_log_odds if unreported and recent_log_odds > verdict.gate else fault_log_odds
    verdict.anomalous = not verdict.warming and verdict.statistic > verdict.gate
    verdict.p_value = min(1.0, false_alarms_per_hour(row.tail, verdict.statistic, p.budget) * dt_s / 3600.0)
    if not verdict.anomalous:
        run_length[:] = 0
    elif unreported:
        ended_probability += mu
        verdict.sensor, verdict.kind, verdict.confidence = isolate_ended(ended_probability)
    else:
        end = 1.0 - exp(-dt_s / p.modes.fault_s)
        verdict.sensor, verdict.kind, verdict.confidence = isolate(mu, run_length, end)
    return recent_log_odds


@njit(cache=True, error_model="numpy")
def write_estimate(row: Any, mean: Any, imm: Any, verdict: Any) -> None:
    """Write the estimate over all modes to `mean` and the VERDICT, and the innovation of HEALTHY."""
    nu, cov = imm.nu, imm.S
    estimate(row, mean)
    verdict.x_m, verdict.v_mps = mean[PX] + row.accumulated_bias_m, mean[VX]
    verdict.x_std_m, verdict.v_std_mps = sqrt(mean[XX]), sqrt(mean[VV])
    verdict.nu[0], verdict.nu[1] = nu[Z_POSITION], nu[Z_SPEED]
    verdict.S[0, 0], verdict.S[0, 1], verdict.S[1, 0], verdict.S[1, 1] = cov[0], cov[1], cov[1], cov[2]
    verdict.nis = imm.nis


@njit(cache=True, error_model="numpy")
def step(row: Any, z: Any, p: HeadwayParams, verdict: Any, workspace: Any) -> None:
    """Update one row (`headway_dtype`) by one READING, in place, and write the VERDICT."""
    noise, driver, mu = row.noise, row.driver, row.mode_probability
    imm, reading, mean = workspace.imm, workspace.reading, workspace.mean
    nu, cov = imm.nu, imm.S
    unexplained = 1.0
    dt_s = z.t_s - row.t_s
    row.t_s = z.t_s
    row.accumulated_bias_m += (noise.speed_bias_mps + noise.speed_latency_s * row.a_mps2) * dt_s
    if row.count == 0 or dt_s > p.max_gap_s:
        verdict.restarted = row.count > 0
        initialise(row, z, p)
        dt_s = 0.0
        nu[:], imm.ended_probability[:], imm.nis = 0.0, 0.0, 0.0
        cov[0], cov[1], cov[2] = noise.r[Z_POSITION], 0.0, noise.r[Z_SPEED]
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m, z.v_mps
    else:
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m - row.accumulated_bias_m, z.v_mps
        unexplained = unexplained_share(driver, noise.jerk_density)
        motion = Motion(noise.jerk_density, noise.random_walk_density, unexplained)
        verdict.repaired = update(row, dt_s, reading, noise.r, motion, verdict.implausible, p.modes, imm)
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    recent_log_odds = detect(row, imm.ended_probability, dt_s, p, verdict)
    write_estimate(row, mean, imm, verdict)

    settled = noise.adapted_readings > p.settled_readings
    if not verdict.warming and settled:
        learn(row.tail, recent_log_odds, verdict.anomalous, dt_s, p.budget)
    if dt_s > 0.0 and mu[HEALTHY] > (ADAPT_ABOVE if settled else ADAPT_ABOVE_EARLY):
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
    """Update one row by one reading."""
    workspace = np.zeros(1, WORKSPACE)
    for place in range(workspace.size):  # the loop keeps the array alive, which a record does not
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
