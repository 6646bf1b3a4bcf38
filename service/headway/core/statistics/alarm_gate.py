"""From the false alarms that an operator accepts to a gate on a vehicle's log odds, learnt while driving.

On clean readings a log likelihood ratio exceeds s with a probability that falls like exp(-s) (Wald's inequality), so
its excursions above a low level have exponential peaks; only their rate and their mean size depend on the car, its
sensors and how well the model fits. Peaks over a threshold (Pickands 1975, doi:10.1214/aos/1176343003):

    alarms per hour at gate g = rate exp(-(g - level) / mean)        gate = level + mean ln(rate / budget)

Real faults must not teach the gate. So nothing is learnt from an excursion that raised an alarm, nor within `holdoff_s`
of one; and only peaks within `truncation` of the level count, whose mean m is that of an exponential cut there,

    m = mean - span / (exp(span / mean) - 1)

A prior worth `prior_exceedances` excursions holds until the vehicle has shown its own, and what was learnt fades with
`memory_s`, for traffic changes.
"""

from math import exp, log
from typing import Any, NamedTuple

import numpy as np
from numba import njit

TAIL = np.dtype(
    [
        ("exceedances", "f8"),  # excursions learnt, each with its peak within `truncation`; fades like the next two
        ("excess_sum", "f8"),  # sum of those peaks above the level
        ("exposure_s", "f8"),  # how long was listened
        ("mean", "f8"),  # of the exponential; 0 in a fresh row: the prior's
        ("current_excess", "f8"),  # excess so far of the excursion under way; 0: none
        ("holdoff_s", "f8"),  # how long still to wait after an alarm
    ],
    align=True,
)


class Budget(NamedTuple):
    """What is accepted, and what a vehicle is taken for before it is known."""

    alarms_per_hour: float
    threshold: float
    truncation: float
    prior_mean: float
    prior_rate_per_hour: float
    prior_exceedances: float
    holdoff_s: float
    memory_s: float


@njit(cache=True, error_model="numpy")
def untruncated_mean(truncated_mean: float, truncation: float) -> float:
    """Return the mean of an exponential whose mean below `truncation` is `truncated_mean`, at most 0.45 of it."""
    target = min(truncated_mean, 0.45 * truncation)
    mean = target
    for _ in range(40):
        mean = target + truncation / (exp(min(truncation / mean, 700.0)) - 1.0)
    return mean


@njit(cache=True, error_model="numpy")
def rate_and_mean(tail: Any, p: Budget) -> tuple[float, float]:
    """Return excursions per hour and the mean size of their peaks, prior included."""
    mean = tail.mean if tail.mean > 0.0 else p.prior_mean
    hours = p.prior_exceedances / p.prior_rate_per_hour + tail.exposure_s / 3600.0
    seen = 1.0 - exp(-p.truncation / p.prior_mean)
    return (p.prior_exceedances * seen + tail.exceedances) / hours / (1.0 - exp(-p.truncation / mean)), mean


@njit(cache=True, error_model="numpy")
def gate(tail: Any, p: Budget) -> float:
    """Return the log odds that clean readings of this vehicle exceed as often as the budget allows."""
    rate, mean = rate_and_mean(tail, p)
    return float(p.threshold + mean * max(log(rate / p.alarms_per_hour), 0.0))


@njit(cache=True, error_model="numpy")
def false_alarms_per_hour(tail: Any, log_odds: float, p: Budget) -> float:
    """Return how often an hour of clean readings of this vehicle goes as high as `log_odds`."""
    rate, mean = rate_and_mean(tail, p)
    return float(rate * exp(-max(log_odds - p.threshold, 0.0) / mean))


@njit(cache=True, error_model="numpy")
def learn(tail: Any, log_odds: float, alarm: bool, dt_s: float, p: Budget) -> None:
    """Take the next log odds, which stood for `dt_s`, and whether they raised an alarm."""
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
