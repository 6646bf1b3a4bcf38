"""Kind of a fault by the shape of its deviations, for filters with a single mode.

Let e_k be the deviations of the faulty sensor from the prediction, k = 1..n since the onset. Three models compete:

    noise   e_k ~ N(0, s^2)          bias   e_k ~ N(b, s^2)          drift   e_k ~ N(c k, s^2)

each with its maximum-likelihood variance, at least the sensor's own, by the Bayesian information criterion (Schwarz
1978, doi:10.1214/aos/1176344136):

    BIC = n ln s^2 + sum (residual^2) / s^2 + parameters x ln n

The confidence is the share of the best one in exp(-BIC / 2). A single reading is `short`.
"""

from math import exp, log
from typing import Any

import numpy as np
from numba import njit

from headway.core.types.records import Kind

EPISODE = np.dtype([("n", "f8"), ("e", "f8"), ("ee", "f8"), ("ke", "f8"), ("kk", "f8")], align=True)
"""Sums over the readings since the onset: n, e_k, e_k^2, k e_k, k^2."""

KIND_SHORT = int(Kind.SHORT)
SHAPES = (int(Kind.NOISE), int(Kind.BIAS), int(Kind.DRIFT))


@njit(cache=True, error_model="numpy")
def add_deviation(episode: Any, e: float) -> None:
    """Add the next deviation."""
    episode.n += 1.0
    episode.e += e
    episode.ee += e * e
    episode.ke += episode.n * e
    episode.kk += episode.n**2


@njit(cache=True, error_model="numpy")
def end_episode(episode: Any) -> None:
    """End the episode."""
    episode.n = episode.e = episode.ee = episode.ke = episode.kk = 0.0


@njit(cache=True, error_model="numpy")
def likeliest_kind(episode: Any, r: float) -> tuple[int, float]:
    """Return (kind, confidence) of an episode of at least one deviation; `r` is the sensor's variance."""
    n = episode.n
    if n < 2.0:
        return KIND_SHORT, 1.0
    residual = (episode.ee, episode.ee - episode.e**2 / n, episode.ee - episode.ke**2 / episode.kk)
    bic = np.empty(3)
    for k in range(3):
        variance = max(residual[k] / n, r)
        bic[k] = n * log(variance) + residual[k] / variance + (0.0 if k == 0 else log(n))
    best = int(np.argmin(bic))
    total = 0.0
    for k in range(3):
        total += exp(-0.5 * (bic[k] - bic[best]))
    return SHAPES[best], 1.0 / total
