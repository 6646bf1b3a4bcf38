"""The gate learns a vehicle's own tail, and real faults do not teach it."""

import numpy as np
import pytest
from numba import njit

from headway.core.statistics.alarm_gate import TAIL, Budget, false_alarms_per_hour, gate, learn, untruncated_mean

BUDGET = Budget(
    alarms_per_hour=1.0,
    threshold=-6.0,
    truncation=4.0,
    prior_mean=1.0,
    prior_rate_per_hour=400.0,
    prior_exceedances=20.0,
    holdoff_s=1.0,
    memory_s=3600.0,
)
DT_S = 0.1


def excursions(rng, hours, per_hour, mean):
    """Log odds at 10 Hz: quiet at -8, with lone peaks of exponential height above the level."""
    odds = np.full(round(hours * 36_000), -8.0)
    at = rng.choice(len(odds) // 20, round(hours * per_hour), replace=False) * 20
    odds[at] = BUDGET.threshold + rng.exponential(mean, len(at))
    return odds


@njit
def run(tail, odds, p):
    """Drive along the log odds."""
    for value in odds:
        learn(tail, value, value > gate(tail, p), DT_S, p)


def test_a_fresh_vehicle_gets_the_gate_of_the_prior() -> None:
    assert gate(np.zeros(1, TAIL)[0], BUDGET) == pytest.approx(-6.0 + np.log(400.0))


@pytest.mark.parametrize(("per_hour", "mean"), [(150.0, 0.8), (400.0, 1.0), (900.0, 1.2)])
@pytest.mark.parametrize("budget", [0.5, 1.0, 5.0])
def test_the_budget_holds_for_cars_unlike_the_prior(per_hour: float, mean: float, budget: float) -> None:
    p = BUDGET._replace(alarms_per_hour=budget)
    tail = np.zeros(1, TAIL)[0]
    rng = np.random.default_rng(0)
    run(tail, excursions(rng, 2.0, per_hour, mean), p)
    true_rate = per_hour * np.exp(-(gate(tail, p) - p.threshold) / mean)
    assert 0.4 * budget < true_rate < 2.0 * budget
    assert false_alarms_per_hour(tail, gate(tail, p), p) == pytest.approx(budget, rel=1e-6)


def test_faults_beyond_the_gate_teach_nothing() -> None:
    rng = np.random.default_rng(1)
    fault_free = excursions(rng, 1.0, 400.0, 1.0)
    with_faults = fault_free.copy()
    for start in rng.choice(len(fault_free) - 20, 300, replace=False):
        with_faults[start : start + 10] = 20.0
        with_faults[start + 10 : start + 14] = (-1.0, -3.0, -5.0, -7.0)
    clean, dirty = np.zeros(1, TAIL)[0], np.zeros(1, TAIL)[0]
    run(clean, fault_free, BUDGET)
    run(dirty, with_faults, BUDGET)
    assert dirty["exceedances"] > 50
    assert gate(dirty, BUDGET) == pytest.approx(gate(clean, BUDGET), abs=0.4)


@pytest.mark.parametrize("mean", [0.3, 1.0, 1.5])
def test_the_mean_of_an_exponential_is_found_from_its_cut_part(mean: float) -> None:
    drawn = np.random.default_rng(2).exponential(mean, 200_000)
    assert untruncated_mean(drawn[drawn < 4.0].mean(), 4.0) == pytest.approx(mean, rel=0.02)
    assert untruncated_mean(3.0, 4.0) < np.inf


def test_what_was_learnt_fades_with_the_traffic_that_taught_it() -> None:
    p = BUDGET._replace(memory_s=600.0)
    rng = np.random.default_rng(3)
    tail = np.zeros(1, TAIL)[0]
    run(tail, excursions(rng, 1.0, 900.0, 1.2), p)
    rough = gate(tail, p)
    run(tail, excursions(rng, 1.0, 150.0, 0.8), p)
    assert gate(tail, p) < rough - 1.0


def test_the_gate_of_a_receiver_is_that_of_heavier_tails() -> None:
    """Between a sensor whose noise is rounding and a receiver, the mean excess is in between."""
    tail, p = np.zeros(1, TAIL)[0], BUDGET._replace(receiver_mean=3.0)
    assert gate(tail, p, 0.0) == gate(tail, BUDGET)
    assert gate(tail, BUDGET) < gate(tail, p, 0.5) < gate(tail, p, 1.0)
    assert gate(tail, p, 1.0) == pytest.approx(-6.0 + 3.0 * np.log(400.0), rel=0.3)
    assert false_alarms_per_hour(tail, gate(tail, p, 1.0), p, 1.0) == pytest.approx(1.0)


def test_a_patient_sender_raises_the_gate_no_further_than_that_of_a_receiver() -> None:
    """Two hours of peaks just below the gate: what is learnt is bounded, whatever is sent."""
    tail, p = np.zeros(1, TAIL)[0], BUDGET._replace(receiver_mean=3.0)
    for _ in range(2000):
        odds = np.full(30, -8.0)
        odds[10] = min(gate(tail, p, 1.0) - 0.01, p.threshold + p.truncation - 0.01)
        run(tail, odds, p)
    assert gate(tail, p, 1.0) < 40.0
