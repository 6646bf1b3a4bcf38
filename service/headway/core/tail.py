"""How rarely a clean statistic goes so high: the gate that keeps an operator's false-alarm budget.

Peaks over a threshold (Pickands 1975, doi:10.1214/aos/1176343003), with the exponential tail that needs only one
number: excursions of the statistic above `from_z` come `rate` times an hour, and their peaks exceed it by `mean` on
average, so that

    alarms per hour at a gate g = rate exp(-(g - from_z) / mean)        g(budget) = from_z + mean ln(rate / budget)

Both numbers are learnt for each row and shrunk to a prior worth `prior_peaks` excursions. A peak counts only up to
the gate: a lie that was caught, or a false alarm, moves the gate by little.
"""

from math import exp, log
from typing import Any, NamedTuple

import numpy as np
from numba import njit

TAIL = np.dtype(
    [
        ("peaks", "f8"),  # excursions finished
        ("excess", "f8"),  # sum of their peaks above from_z
        ("exposure_s", "f8"),  # how long was looked
        ("peak", "f8"),  # of the excursion under way; 0: none
    ],
    align=True,
)


class TailParams(NamedTuple):
    """The prior is that of speed changes that drivers leave unexplained, between a Gaussian (0.37) and heavier."""

    budget_per_hour: float
    from_z: float = 2.0
    prior_mean: float = 0.5
    prior_rate_per_hour: float = 200.0
    prior_peaks: float = 20.0


@njit(cache=True)
def rate_and_mean(tail: Any, p: TailParams) -> tuple[float, float]:
    """Return excursions per hour and the mean excess of their peaks."""
    peaks = p.prior_peaks + tail.peaks
    hours = p.prior_peaks / p.prior_rate_per_hour + tail.exposure_s / 3600.0
    return peaks / hours, (p.prior_peaks * p.prior_mean + tail.excess) / peaks


@njit(cache=True)
def tail_gate(tail: Any, p: TailParams) -> float:
    """Return the gate that the budget asks for; never below `from_z`."""
    rate, mean = rate_and_mean(tail, p)
    return float(p.from_z + mean * max(log(rate / p.budget_per_hour), 0.0))


@njit(cache=True)
def alarms_per_hour(tail: Any, z: float, p: TailParams) -> float:
    """Return how often an hour of clean readings goes as high as `z`; below `from_z` this is only a bound."""
    rate, mean = rate_and_mean(tail, p)
    return float(rate * exp(-max(z - p.from_z, 0.0) / mean))


@njit(cache=True)
def tail_learn(tail: Any, z: float, gate: float, dt_s: float, p: TailParams) -> None:
    """Take one more statistic that stood for `dt_s`."""
    tail.exposure_s += dt_s
    if z > p.from_z:
        tail.peak = max(tail.peak, min(z, gate))
    elif tail.peak > 0.0:
        tail.peaks += 1.0
        tail.excess += tail.peak - p.from_z
        tail.peak = 0.0
