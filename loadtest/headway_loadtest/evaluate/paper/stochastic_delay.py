"""A Monte Carlo check of equation `stochastic-delay`: the effect of a random delay on the filter's input.

With tau_s = tau + kappa, kappa ~ N(0, sigma^2), the delayed input differs from the expected one by

    eps(kappa) = u(t - tau - kappa) - u(t - tau),    u = [x_leader, v_leader]

and the filter takes its covariance to first order in kappa, with mean zero:

    sigma^2 [[v^2, v a], [v a, a^2]]                 v, a of the leader at t - tau

The next order has a mean of its own, sigma^2 / 2 [a, a'], and for a steady a it adds a^2 sigma^4 / 2 to the location's
variance: first order fails where the leader stands or is about to move (v near 0) and where a changes within sigma.
"""

from dataclasses import dataclass

import numpy as np

from headway_loadtest.evaluate.paper.leader import INTERVAL_S, Leader
from headway_loadtest.sources.drive import F64

DRAWS = 400
REACH = 4.0
"""Instants closer than this many sigma to an end of the drive are left out."""


@dataclass(frozen=True, slots=True)
class EpsMoments:
    """Of eps at m instants: mean (m, 2) and covariance (m, 2, 2) as drawn, and the first-order covariance (m, 2, 2)."""

    mean: F64
    covariance: F64
    first_order: F64

    @property
    def std_ratio(self) -> F64:
        """(2,) root of drawn over first-order variance, both averaged over the instants: 1 where the claim holds."""
        drawn, claimed = (np.diagonal(c, axis1=1, axis2=2).mean(axis=0) for c in (self.covariance, self.first_order))
        made: F64 = np.sqrt(drawn / claimed)
        return made

    def understated(self, factor: float = 2.0) -> F64:
        """(2,) share of the instants where the first order claims less than 1/factor of the drawn deviation."""
        drawn, claimed = (np.diagonal(c, axis1=1, axis2=2) for c in (self.covariance, self.first_order))
        made: F64 = (drawn > factor**2 * claimed).mean(axis=0)
        return made


def eps_moments(leader: Leader, jitter_s: float, rng: np.random.Generator, draws: int = DRAWS) -> EpsMoments:
    """Draw eps `draws` times at each sample of a drive (for any tau: only t - tau matters), kappa in antithetic pairs.

    Between samples the leader's speed is on the straight line, his location its integral; his acceleration is the
    central difference over two samples.
    """
    t_s, v = leader.t_s, leader.v_mps
    x = np.r_[0.0, np.cumsum(INTERVAL_S * 0.5 * (v[1:] + v[:-1]))]
    margin = int(np.ceil(REACH * jitter_s / INTERVAL_S)) + 1
    inner = slice(margin, len(t_s) - margin)
    half = np.clip(rng.normal(0.0, jitter_s, (len(t_s[inner]), draws // 2)), -REACH * jitter_s, REACH * jitter_s)
    kappa = np.concatenate([half, -half], axis=1)
    delayed_s = t_s[inner, None] - kappa
    before = np.clip((delayed_s / INTERVAL_S).astype(int), 0, len(t_s) - 2)
    past_s = delayed_s - t_s[before]
    slope = (v[before + 1] - v[before]) / INTERVAL_S
    eps = np.stack(
        [
            x[before] + past_s * (v[before] + 0.5 * slope * past_s) - x[inner, None],
            v[before] + slope * past_s - v[inner, None],
        ],
        axis=-1,
    )
    mean = eps.mean(axis=1)
    centred = eps - mean[:, None]
    covariance = np.einsum("mdi,mdj->mij", centred, centred) / (draws - 1)
    direction = np.stack([v, np.gradient(v, INTERVAL_S)], axis=-1)[inner]
    first_order = jitter_s**2 * direction[:, :, None] * direction[:, None, :]
    return EpsMoments(mean, covariance, first_order)
