"""The default model `headway`: one vehicle's own position and speed, by ten modes of its sensors.

For each reading:

    update              mode probabilities and filters (`modes`, `state`, `update`)
    adapt_noise         noise of sensors and driver, from healthy readings (`noise_adaptation`)
    update_calibration  bias, scale and latency of the speed, from healthy readings (`speed_calibration`)
    gate                threshold of the log odds (fault : healthy), from the alarm budget (`alarm_gate`)
    isolate             sensor and kind (`fault_isolation`)
    fault_timeout       reset of a fault that does not end (`fault_timeout`)

The estimate is the mean over all modes: a faulty sensor has no part in it, and the other sensor keeps correcting it.
The motion is x' = v at the same instant. A delay belongs to the driver's response to the leader (`driver_input`).
Contradictions between two vehicles are tested in `consistency`.
"""

from math import exp, inf, log, sqrt
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
from headway.core.estimation.imm.fixes import SLOW_SHARE, STANDING_MPS, is_late, repeats_position
from headway.core.estimation.imm.modes import HEALTHY
from headway.core.estimation.imm.noise_adaptation import (
    ADAPTED_NOISE,
    SETTLED_READINGS,
    NoiseAdaptationParams,
    adapt_noise,
    initialise_noise,
    position_variance,
    reset_previous_innovation,
    settled_readings,
    step_size,
)
from headway.core.estimation.imm.speed_calibration import (
    CALIBRATION,
    LATENCY,
    CalibrationParams,
    calibration_variance,
    correct_mean_speed,
    initialise_calibration,
    observe_dead_zone,
    observe_speed_step,
    predict_calibration,
    update_calibration,
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

NOD_MPS, NOD_STD_M = 0.5, 0.03
"""Speed below which a car that stops or sets off nods and rolls, and by how much that moves its antenna."""
TIMED_MPS = 5.0
"""Speed above which noise of the position may be noise of the time stamps, m/s."""
ADAPT_ABOVE = 0.5
"""Probability of HEALTHY above which a reading adapts the noise."""
ADAPT_ABOVE_EARLY = 0.3
"""The same until the noise has settled: a variance that starts too small makes healthy readings doubtful (ADR 0006).
A doubtful reading that raises no alarm adapts the noise as well. Else a mode of noise would take each large innovation,
and the noise would stay too small (ADR 0011)."""
KNOWN_WARMING_READINGS = 5
"""A row whose noise is known warms up in so many readings after a gap: the acceleration is known by then."""
GATE_MAX = -0.99 * log(MODE_PROBABILITY_FLOOR)
"""Log odds end soon above it. A higher gate, of a budget near zero or of a heavy tail, would hide every fault."""
HARD_CHANGE_MPS = 1.5
"""Change of speed since the positions that still count, from which an error of the latency looks like a fault. Then
readings that raise no alarm teach the calibration too (ADR 0011)."""


def headway_dtype(delay_s: float) -> np.dtype[np.void]:
    """Return the record of one vehicle, whose ring of inputs reaches back `delay_s`."""
    return np.dtype(
        [
            ("count", "i8"),  # readings, of those before a gap at most some; 0: a row that is not initialised
            ("t_s", "f8"),  # of the newest reading that the filters have
            ("last_t_s", "f8"),  # of the newest reading
            ("position_unchanged_s", "f8"),  # for how long the newest position has been reported
            ("late_s", "f8"),  # for how long positions have come one interval late
            *((name, MODES[name]) for name in MODES.names or ()),
            ("noise", ADAPTED_NOISE),
            ("calibration", CALIBRATION),
            ("tail", TAIL),
            ("accumulated_bias_m", "f8"),  # of the speed calibration: position less integral of the speed
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
    calibration: CalibrationParams = CalibrationParams()
    fault_time_max_s: float = 2.5
    """Time-out of a fault, s (ADR 0005: 3.5 s keeps every lock-in for longer)."""
    fault_share_max: float = 0.5
    """A fault times out earlier if it exceeds this share of the time observed."""
    gate_margin: float = 28.0
    """Added to the gate, times the root of the step that the noise still takes beyond its least (ADR 0006)."""
    speed_step_variance: float = 0.75
    """Variance of a speed, as a share of its squared step. A rounding error has 1/12, but lasts as long as the speed
    stays, and a nearly constant speed is wrong by up to half a step throughout."""
    calibration_margin: float = 2.0
    """Factor on the variance of an innovation in the calibration, times the step beyond its least, plus 1."""
    settled_readings: float = SETTLED_READINGS
    """Adapted readings from which the tail of the gate is learnt."""


def headway_params(config: DetectorConfig) -> HeadwayParams:
    """Return the model's numbers for the settings of a detector."""
    # Excursions of the log odds on clean readings: ADR 0006.
    budget = Budget(
        alarms_per_hour=config.alarm_budget_per_hour,
        threshold=-6.0,
        truncation=4.0,
        prior_mean=0.85,
        prior_rate_per_hour=200.0,
        prior_exceedances=100.0,
        holdoff_s=1.0,
        memory_s=900.0,
        receiver_mean=3.45,
    )
    driver = DriverParams(IdmParams(), config.delay_s)
    return HeadwayParams(budget, driver, config.max_gap_s, config.warming_readings)


WORKSPACE = np.dtype(
    [("imm", IMM_WORKSPACE), ("reading", "f8", (2,)), ("r", "f8", (2,)), ("mean", "f8", (SIZE,))], align=True
)
"""What `step` works in: a record, because its parts are not counted references as slices of an array are."""


@njit(cache=True, error_model="numpy")
def initialise(row: Any, z: Any, p: HeadwayParams) -> None:
    """Initialise a row at a reading; adapted noise, calibration, response gain and alarm tail are kept."""
    if row.noise.r[Z_POSITION] == 0.0:
        initialise_noise(row.noise, p.noise)
        initialise_calibration(row.calibration, p.calibration)
    reset_previous_innovation(row.noise)
    initialise_modes(row, z.x_m, z.v_mps, row.noise.r, p.modes)
    initialise_driver(row.driver, p.driver)
    row.accumulated_bias_m, row.a_mps2, row.late_s = 0.0, 0.0, 0.0
    row.calibration.sensitivity[:] = 0.0
    row.calibration.last_speed_mps = row.calibration.mean_speed_mps = z.v_mps
    row.fault_time_s[:] = 0.0
    row.observed_s = 0.0
    row.last_reset_s = z.t_s
    row.run_length[:] = 0
    row.count = min(row.count, max(p.warming_readings - KNOWN_WARMING_READINGS, 0))


@njit(cache=True, error_model="numpy")
def log_odds(fault_probability: float, healthy_probability: float) -> float:
    """Return ln(fault : healthy), within the range of mode probabilities."""
    return float(log(max(fault_probability, MODE_PROBABILITY_FLOOR) / max(healthy_probability, MODE_PROBABILITY_FLOOR)))


@njit(cache=True, error_model="numpy")
def current_gate(row: Any, p: HeadwayParams) -> float:
    """Return the gate of the budget, which log odds can exceed, and the margin for noise that has not settled."""
    of_budget = min(gate(row.tail, p.budget, row.noise.receiver), GATE_MAX)
    return float(of_budget + p.gate_margin * sqrt(step_size(row.noise, p.noise) - p.noise.step_min))


@njit(cache=True, error_model="numpy")
def detect(row: Any, ended_probability: Any, dt_s: float, p: HeadwayParams, verdict: Any) -> float:
    """Write statistic, gate and fault of the VERDICT; return the log odds of a fault now or until this reading."""
    mu, run_length = row.mode_probability, row.run_length
    fault = 1.0 - mu[HEALTHY] if mu[HEALTHY] < 0.5 else mu[1:].sum()
    ended = ended_probability.sum()
    fault_log_odds = log_odds(fault, mu[HEALTHY])
    recent_log_odds = log_odds(fault + ended, mu[HEALTHY] - ended)
    verdict.gate = current_gate(row, p)
    # A fault that is detected only as it ends is an alarm as well; one that was reported before has simply ended.
    unreported = fault_log_odds <= verdict.gate and run_length[Z_POSITION] + run_length[Z_SPEED] == 0
    verdict.statistic = recent_log_odds if unreported and recent_log_odds > verdict.gate else fault_log_odds
    verdict.anomalous = not verdict.warming and verdict.statistic > verdict.gate
    per_hour = false_alarms_per_hour(row.tail, verdict.statistic, p.budget, row.noise.receiver)
    verdict.p_value = min(1.0, per_hour * dt_s / 3600.0)
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
def repeat_verdict(row: Any, z: Any, p: HeadwayParams, mean: Any, imm: Any, verdict: Any) -> None:
    """Write the VERDICT of a message that repeats position and speed: the last one, with the estimate at its time."""
    dt_s = z.t_s - row.t_s
    imm.ended_probability[:] = 0.0
    verdict.warming = row.count <= p.warming_readings
    detect(row, imm.ended_probability, dt_s, p, verdict)
    estimate(row, mean)
    verdict.x_m = mean[PX] + row.accumulated_bias_m + dt_s * mean[VX] + 0.5 * dt_s**2 * mean[AX]
    verdict.v_mps = mean[VX] + dt_s * mean[AX]
    verdict.x_std_m, verdict.v_std_mps = sqrt(mean[XX]), sqrt(mean[VV])
    verdict.S[0, 0], verdict.S[1, 1] = position_variance(row.noise, z.v_mps), row.noise.r[Z_SPEED]


@njit(cache=True, error_model="numpy")
def step(row: Any, z: Any, p: HeadwayParams, verdict: Any, workspace: Any) -> None:
    """Update one row (`headway_dtype`) by one READING, in place, and write the VERDICT."""
    noise, calibration, driver, mu = row.noise, row.calibration, row.driver, row.mode_probability
    imm, reading, r, mean = workspace.imm, workspace.reading, workspace.r, workspace.mean
    nu, cov = imm.nu, imm.S
    dt_s = z.t_s - row.t_s
    measured = not repeats_position(row, z) or dt_s > p.max_gap_s
    repeats_all = not measured and z.v_mps == calibration.last_speed_mps and verdict.implausible == 0
    if repeats_all and (z.v_mps > STANDING_MPS or calibration.repeat_share > SLOW_SHARE):
        repeat_verdict(row, z, p, mean, imm, verdict)
        return
    row.t_s = z.t_s
    changed, uncertain, kept, change_mps = True, 0.0, 1.0, 0.0
    v_mps = row.single[VX, HEALTHY]
    unexplained = unexplained_share(driver, noise.jerk_density) if row.count > 0 else 1.0
    motion = Motion(
        noise.jerk_density, noise.random_walk_density, noise.manoeuvre, unexplained, calibration.dead_zone_mps
    )
    if row.count == 0 or dt_s > p.max_gap_s:
        verdict.restarted = row.count > 0
        initialise(row, z, p)
        dt_s = 0.0
        nu[:], imm.ended_probability[:], imm.nis = 0.0, 0.0, 0.0
        r[:] = noise.r
        cov[0], cov[1], cov[2] = r[Z_POSITION], 0.0, r[Z_SPEED]
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m, z.v_mps
    else:
        row.accumulated_bias_m += predict_calibration(calibration, dt_s, v_mps, row.a_mps2)
        changed = observe_speed_step(calibration, z.v_mps, p.calibration)
        reading[Z_POSITION], reading[Z_SPEED] = z.x_m - row.accumulated_bias_m, z.v_mps
        uncertain = calibration_variance(calibration)
        r[Z_POSITION] = position_variance(noise, v_mps) + uncertain
        measured = measured and not is_late(row, reading[Z_POSITION], dt_s, r[Z_POSITION])
        if not measured:
            r[Z_POSITION] = inf
        rounding = p.speed_step_variance * calibration.speed_held
        r[Z_SPEED] = max(noise.r[Z_SPEED], rounding * calibration.speed_step_mps**2)
        if measured and z.odometer_std_m > 0.0:
            r[Z_POSITION] += z.odometer_std_m**2
        if v_mps < NOD_MPS:
            r[Z_POSITION] += NOD_STD_M**2
        # A time stamp that moves the position by its error times v, moves the speed by its error times a.
        r[Z_SPEED] += row.a_mps2**2 * position_variance(noise, v_mps) / max(v_mps, TIMED_MPS) ** 2
        verdict.repaired = update(row, dt_s, reading, r, motion, verdict.implausible, p.modes, imm)
        change_mps = row.single[VX, HEALTHY] - v_mps - row.a_mps2 * dt_s
        kept = r[Z_POSITION] / cov[0] if measured else 1.0
    row.count += 1
    verdict.warming = row.count <= p.warming_readings
    recent_log_odds = detect(row, imm.ended_probability, dt_s, p, verdict)
    write_estimate(row, mean, imm, verdict)

    settled = settled_readings(noise) > p.settled_readings
    if not verdict.warming and settled:
        learn(row.tail, recent_log_odds, verdict.anomalous, dt_s, p.budget)
    healthy = dt_s > 0.0 and mu[HEALTHY] > (ADAPT_ABOVE if settled else ADAPT_ABOVE_EARLY)
    unproven = dt_s > 0.0 and verdict.implausible == 0 and verdict.statistic < verdict.gate
    if healthy or unproven:
        adapt_noise(noise, r, z.v_mps, nu, cov, motion, row.manoeuvring, measured, changed, p.noise)
    if healthy:
        observe_dead_zone(calibration, z.v_mps, p.calibration)
    if healthy or (unproven and abs(calibration.sensitivity[LATENCY]) > HARD_CHANGE_MPS):
        if measured:
            settling = 1.0 + p.calibration_margin * (step_size(noise, p.noise) - p.noise.step_min)
            variance = settling * (cov[0] - uncertain)
            row.accumulated_bias_m += kept * update_calibration(
                calibration, nu[Z_POSITION], variance, r[Z_SPEED], p.calibration
            )
        k_v, k_a = row.single[VV, HEALTHY] / r[Z_SPEED], row.single[VA, HEALTHY] / r[Z_SPEED]
        adapt_response_gain(driver, dt_s, nu[Z_SPEED], cov[2], k_v, k_a, p.driver)
    else:
        reset_previous_innovation(noise)
        reset_sensitivity(driver)
    calibration.sensitivity *= kept
    row.accumulated_bias_m += correct_mean_speed(calibration, change_mps, kept)
    if measured and verdict.implausible == 0 and fault_timeout(row, mean, reading, r, dt_s, p):
        verdict.restarted = True
        calibration.mean_speed_mps = row.single[VX, HEALTHY]
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
