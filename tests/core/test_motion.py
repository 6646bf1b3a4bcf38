"""One hypothesis against matrices."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import norm, t

from headway.core.motion import NEGLIGIBLE, SIZE, accuse, blend, disregard, merge, observe, predict

TRIANGLE = np.triu_indices(5)


def random_hypothesis(rng):
    root = rng.normal(size=(5, 5))
    return packed(rng.normal(size=5), root @ root.T + 0.1 * np.eye(5))


def packed(mean, cov):
    m = np.empty(SIZE)
    m[:5], m[5:] = mean, cov[TRIANGLE]
    return m


def unpacked(m):
    cov = np.zeros((5, 5))
    cov[TRIANGLE] = m[5:]
    return m[:5].copy(), cov + np.triu(cov, 1).T


def test_prediction_solves_the_stated_equations() -> None:
    """Van Loan 1978: the covariance of a linear system from one matrix exponential."""
    A = np.zeros((5, 5))
    A[0, 1] = A[1, 2] = A[3, 4] = 1.0
    q, walk, h = 0.7, 0.3, 0.37
    noise = np.zeros((5, 5))
    noise[2, 2] = q
    block = expm(h * np.block([[-A, noise], [np.zeros((5, 5)), A.T]]))
    F = block[5:, 5:].T
    m = random_hypothesis(np.random.default_rng(0))
    mean, cov = unpacked(m)
    expected = F @ cov @ F.T + F @ block[:5, 5:]
    expected[0, 0] += walk * h
    predict(m, h, q, walk)
    got_mean, got_cov = unpacked(m)
    np.testing.assert_allclose(got_mean, F @ mean, rtol=1e-12)
    np.testing.assert_allclose(got_cov, expected, rtol=1e-9)


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("lying", [False, True])
def test_an_observation_is_a_kalman_update_and_returns_its_likelihood(sensor: int, lying: bool) -> None:
    m = random_hypothesis(np.random.default_rng(1))
    mean, cov = unpacked(m)
    H = np.zeros(5)
    H[sensor] = 1.0
    H[3] += float(lying)
    S = H @ cov @ H + 0.2
    K = cov @ H / S
    likelihood = observe(m, sensor, lying, 1.5, 0.2)
    assert likelihood == pytest.approx(norm.pdf(1.5, H @ mean, np.sqrt(S)))
    got_mean, got_cov = unpacked(m)
    np.testing.assert_allclose(got_mean, mean + K * (1.5 - H @ mean), rtol=1e-10)
    np.testing.assert_allclose(got_cov, cov - np.outer(K, H @ cov), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("sensor", [0, 1])
def test_an_accused_sensor_is_one_with_a_diffuse_offset(sensor: int) -> None:
    """The limit of an update with an offset of no prior knowledge, a variance of 1e8."""
    m = random_hypothesis(np.random.default_rng(2))
    mean, cov = unpacked(m)
    cov[3:, :] = cov[:, 3:] = 0.0
    mean[3:] = 0.0
    cov[3, 3] = 1e8
    wide = packed(mean, cov)
    observe(wide, sensor, True, 3.0, 0.2)
    accuse(m, sensor, 3.0, 0.2)
    np.testing.assert_allclose(m[:5], wide[:5], atol=1e-5)
    np.testing.assert_allclose(m[5:], wide[5:], atol=1e-5)


def test_a_disregarded_reading_has_heavy_tails() -> None:
    m = random_hypothesis(np.random.default_rng(3))
    mean, cov = unpacked(m)
    for z in (0.0, 1.0, 50.0):
        expected = t.pdf(z, 2, mean[1], np.sqrt(cov[1, 1] + 0.2 + 0.3**2))
        assert disregard(m, 1, z, 0.2, 0.3) == pytest.approx(expected)


def test_merging_keeps_mean_and_covariance_of_the_mixture() -> None:
    rng = np.random.default_rng(4)
    a, b = random_hypothesis(rng), random_hypothesis(rng)
    (mean_a, cov_a), (mean_b, cov_b) = unpacked(a), unpacked(b)
    mean = 0.75 * mean_a + 0.25 * mean_b
    spread = [np.outer(d, d) for d in (mean_a - mean, mean_b - mean)]
    assert merge(a, 0.3, b, 0.1) == pytest.approx(0.4)
    np.testing.assert_allclose(unpacked(a)[0], mean, rtol=1e-12)
    np.testing.assert_allclose(unpacked(a)[1], 0.75 * (cov_a + spread[0]) + 0.25 * (cov_b + spread[1]), rtol=1e-10)


def test_a_share_too_small_to_matter_is_not_merged() -> None:
    rng = np.random.default_rng(5)
    a, b = random_hypothesis(rng), random_hypothesis(rng)
    before = a.copy()
    assert merge(a, 1.0, b, 0.5 * NEGLIGIBLE) == pytest.approx(1.0)
    np.testing.assert_array_equal(a, before)


def test_a_blend_is_a_merge_of_many_without_their_lies() -> None:
    rng = np.random.default_rng(6)
    M = np.stack([random_hypothesis(rng) for _ in range(4)])
    weights = np.array([0.5, 0.2, 0.2, 0.1])
    into = np.empty(SIZE)
    assert blend(M, weights, into) == pytest.approx(1.0)
    merged, weight = M[0].copy(), 0.5
    for m, more in zip(M[1:], weights[1:], strict=True):
        weight = merge(merged, weight, m, more)
    (mean, cov), (wanted_mean, wanted_cov) = unpacked(into), unpacked(merged)
    np.testing.assert_allclose(mean[:3], wanted_mean[:3], rtol=1e-9)
    np.testing.assert_allclose(cov[:3, :3], wanted_cov[:3, :3], rtol=1e-9)
    assert not mean[3:].any()
    assert not cov[3:].any()
