"""The claim on a random delay, where it is exact, and where first order fails."""

import numpy as np
import pytest

from headway_loadtest.evaluate.paper.leader import INTERVAL_S, Leader
from headway_loadtest.evaluate.paper.stochastic_delay import eps_moments

JITTER_S = 0.2


def smooth_path(v0_mps: float, a_mps2: float) -> Leader:
    t_s = INTERVAL_S * np.arange(200)
    return Leader(v0_mps * t_s + 0.5 * a_mps2 * t_s**2, v0_mps + a_mps2 * t_s)


def test_under_constant_acceleration_the_moments_are_the_expansions_own() -> None:
    """eps = [-v kappa + a kappa^2 / 2, -a kappa]: mean [a sigma^2 / 2, 0], variance of location + a^2 sigma^4 / 2."""
    a = 1.5
    leader = smooth_path(3.0, a)
    found = eps_moments(leader, JITTER_S, np.random.default_rng(1), draws=20_000)
    margin = (200 - len(found.mean)) // 2
    v = leader.v_mps[margin:-margin]
    assert found.mean[:, 0].mean() == pytest.approx(0.5 * a * JITTER_S**2, rel=0.05)
    assert found.mean[:, 1].mean() == pytest.approx(0.0, abs=1e-3)
    expected = JITTER_S**2 * np.array([[v**2 + 0.5 * (a * JITTER_S) ** 2, v * a], [v * a, np.full_like(v, a * a)]])
    np.testing.assert_allclose(found.covariance, expected.transpose(2, 0, 1), rtol=0.06)


def test_first_order_is_right_for_a_leader_who_keeps_moving() -> None:
    found = eps_moments(smooth_path(5.0, 0.5), JITTER_S, np.random.default_rng(2))
    assert found.std_ratio == pytest.approx([1.0, 1.0], abs=0.02)
    assert found.understated().max() == 0.0


def test_first_order_fails_for_a_leader_who_is_about_to_move() -> None:
    """At rest the formula says that nothing is uncertain; the start within sigma says otherwise."""
    t_s = INTERVAL_S * np.arange(200)
    v_mps = np.maximum(0.0, 1.5 * (t_s - 10.0))
    found = eps_moments(Leader(np.cumsum(INTERVAL_S * v_mps), v_mps), 1.0, np.random.default_rng(3))
    assert (found.understated() > 0.05).all()


def test_the_covariance_grows_with_the_square_of_sigma() -> None:
    small, large = (eps_moments(smooth_path(8.0, 0.3), s, np.random.default_rng(4)) for s in (0.05, 0.1))
    ratio = large.covariance.mean(axis=0)[0, 0] / small.covariance.mean(axis=0)[0, 0]
    assert ratio == pytest.approx(4.0, rel=0.05)
