"""Upper quantiles of the chi-square distribution with one and with two degrees of freedom, in closed form."""

import math
from statistics import NormalDist


def gate_of_one(tail: float) -> float:
    """Return what the square of a standard normal variable exceeds with probability `tail`."""
    return NormalDist().inv_cdf(tail / 2.0) ** 2


def gate_of_two(tail: float) -> float:
    """Return what the sum of two such squares exceeds with probability `tail`: F(x) = 1 - exp(-x/2)."""
    return -2.0 * math.log(tail)
