"""The gate of a statistic from an accepted rate of false alarms, learnt for each vehicle from its own readings.

On clean readings a log likelihood ratio exceeds s with a probability of order exp(-s) (Wald 1945,
doi:10.1214/aoms/1177731118). So its excursions above a low threshold u have exponential peaks. Only their rate and mean
excess depend on vehicle, sensors and fit of the model (peaks over threshold; Pickands 1975,
doi:10.1214/aos/1176343003):

    alarms per hour at gate g = rate exp(-(g - u) / mean)        gate = u + mean ln(rate / budget)

Real faults must not raise the gate. So an excursion that raised an alarm is not learnt, nor one within `holdoff_s` of
it. Only peaks less than the truncation T above u count. Their mean m is that of an exponential cut at T, so

    m = mean - T / (exp(T / mean) - 1)

The prior weighs as much as `prior_exceedances` excursions. What was learnt fades with `memory_s`, as traffic changes.
"""

from math import exp, log
from typing import Any, NamedTuple

import numpy as np
from numba import njit

TAIL = np.dtype(
    [
        ("exceedances", "f8"),  # excursions with a peak below the truncation; fades like the next two
        ("excess_sum", "f8"),  # sum of their peaks above the threshold
        ("exposure_s", "f8"),  # observed time
        ("mean", "f8"),  # of the exponential; 0 in a new row: that of the prior
        ("current_excess", "f8"),  # largest excess of the present excursion; 0: none
        ("holdoff_s", "f8"),  # remaining time without learning after an alarm
    ],
    align=True,
)


class Budget(NamedTuple):
    """The accepted false alarms, and the prior tail of a vehicle. Values: ADR 0006."""

    alarms_per_hour: float
    threshold: float
    """u, in units of the statistic."""
    truncation: float
    """T, in units of the statistic."""
    prior_mean: float
    """Mean excess of a peak above u, in units of the statistic."""
    prior_rate_per_hour: float
    """Excursions per hour."""
    prior_exceedances: float
    """Excursions that the prior is worth."""
    holdoff_s: float
    """Time without learning after an alarm, s."""
    memory_s: float
    """Time constant of the learnt tail, s."""
    receiver_mean: float = 0.0
    """Least mean excess for a sensor whose noise is that of a receiver: its errors have heavier tails."""


@njit(cache=True, error_model="numpy")
def untruncated_mean(truncated_mean: float, truncation: float) -> float:
    """Return the mean of an exponential whose mean below `truncation` is `truncated_mean`; at most 0.45 of it counts.

    The fixed point converges below half of the truncation, which is the truncated mean of an unbounded mean.
    """
    target = min(truncated_mean, 0.45 * truncation)
    mean = target
    for _ in range(40):
        mean = target + truncation / (exp(min(truncation / mean, 700.0)) - 1.0)
    return mean


@njit(cache=True, error_model="numpy")
def rate_and_mean(tail: Any, p: Budget, receiver: float = 0.0) -> tuple[float, float]:
    """Return excursions per hour and the mean excess of their peaks, prior included.

    `receiver` says from 0 to 1 how much the sensor is a receiver, and not one whose noise is that of rounding.
    """
    mean = tail.mean if tail.mean > 0.0 else p.prior_mean
    mean = max(mean, receiver * p.receiver_mean)
    hours = p.prior_exceedances / p.prior_rate_per_hour + tail.exposure_s / 3600.0
    seen = 1.0 - exp(-p.truncation / p.prior_mean)
    return (p.prior_exceedances * seen + tail.exceedances) / hours / (1.0 - exp(-p.truncation / mean)), mean


@njit(cache=True, error_model="numpy")
def gate(tail: Any, p: Budget, receiver: float = 0.0) -> float:
    """Return the gate that clean readings of this vehicle exceed at the accepted rate."""
    rate, mean = rate_and_mean(tail, p, receiver)
    return float(p.threshold + mean * max(log(rate / p.alarms_per_hour), 0.0))


@njit(cache=True, error_model="numpy")
def false_alarms_per_hour(tail: Any, log_odds: float, p: Budget, receiver: float = 0.0) -> float:
    """Return how many excursions per hour of clean readings of this vehicle reach `log_odds`."""
    rate, mean = rate_and_mean(tail, p, receiver)
    return float(rate * exp(-max(log_odds - p.threshold, 0.0) / mean))


@njit(cache=True, error_model="numpy")
def learn(tail: Any, log_odds: float, alarm: bool, dt_s: float, p: Budget) -> None:
    """Learn from the next log odds, which held for `dt_s`, and from whether they raised an alarm."""
    if alarm:
        tail.holdoff_s = p.holdoff_s
        tail.current_excess = 0.0
        return
    if tail.holdoff_s > 0.0:
        tail.holdoff_s -= dt_s
        return
    kept = 1.0 - dt_s / p.memory_s
    tail.exceedances *= kept
    tail.excess_sum *= kept
    tail.exposure_s = kept * tail.exposure_s + dt_s
    if log_odds > p.threshold:
        tail.current_excess = max(tail.current_excess, log_odds - p.threshold)
    elif tail.current_excess > 0.0:
        if tail.current_excess < p.truncation:
            tail.exceedances += 1.0
            tail.excess_sum += tail.current_excess
            seen = 1.0 - exp(-p.truncation / p.prior_mean)
            prior = p.prior_exceedances * (p.prior_mean * seen - p.truncation * (1.0 - seen))
            tail.mean = untruncated_mean(
                (prior + tail.excess_sum) / (p.prior_exceedances * seen + tail.exceedances), p.truncation
            )
        tail.current_excess = 0.0
