"""One filter against matrices."""

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import norm, t

from headway.core.estimation.kinematics import (
    NO_COLUMN,
    SIZE,
    WEIGHT_NEGLIGIBLE,
    filters,
    likelihood,
    moment_match_weighted,
    predict,
    repair_covariance,
    reset_likelihood,
    set_offset,
    update_scalar,
)

TRIANGLE = np.triu_indices(5)
WIDTH = 8


def beside(*ms):
    """Return these filters as columns; the other columns hold the last of them."""
    made = np.zeros(1, filters(WIDTH))[0]
    made["m"][:] = np.stack([*ms, *[ms[-1]] * (WIDTH - len(ms))], axis=1)
    reset_likelihood(made)
    return made


def random_filter(rng):
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


@pytest.mark.parametrize("sensor", [0, 1])
def test_a_variance_that_rounding_took_below_zero_leaves_a_likelihood(sensor: int) -> None:
    """As after an update of a vehicle that is a million metres off; also in a column that uses the reading."""
    m = packed(np.zeros(5), np.diag([-1e3, -1e3, 1.0, 1.0, 1.0]))
    together = beside(m)
    update_scalar(together, sensor, 100.0, 0.2, 0.3, ((1, NO_COLUMN), (0, NO_COLUMN)))
    assert all(np.isfinite(likelihood(together, j)) for j in range(WIDTH))


def test_prediction_solves_the_stated_equations() -> None:
    """Van Loan 1978: the covariance of a linear system from one matrix exponential."""
    A = np.zeros((5, 5))
    A[0, 1] = A[1, 2] = A[3, 4] = 1.0
    q, random_walk_density, h = 0.7, 0.3, 0.37
    noise = np.zeros((5, 5))
    noise[2, 2] = q
    block = expm(h * np.block([[-A, noise], [np.zeros((5, 5)), A.T]]))
    F = block[5:, 5:].T
    m = random_filter(np.random.default_rng(0))
    mean, cov = unpacked(m)
    expected = F @ cov @ F.T + F @ block[:5, 5:]
    expected[0, 0] += random_walk_density * h
    together = beside(random_filter(np.random.default_rng(9)), m)
    predict(together, h, q, random_walk_density)
    got_mean, got_cov = unpacked(together["m"][:, 1])
    np.testing.assert_allclose(got_mean, F @ mean, rtol=1e-12)
    np.testing.assert_allclose(got_cov, expected, rtol=1e-9)


@pytest.mark.parametrize("sensor", [0, 1])
@pytest.mark.parametrize("faulty", [False, True])
def test_a_reading_is_a_kalman_update_and_notes_its_likelihood(sensor: int, faulty: bool) -> None:
    m = random_filter(np.random.default_rng(1))
    mean, cov = unpacked(m)
    H = np.zeros(5)
    H[sensor] = 1.0
    H[3] += float(faulty)
    S = H @ cov @ H + 0.2
    K = cov @ H / S
    together = beside(random_filter(np.random.default_rng(9)), m)
    update_scalar(together, sensor, 1.5, 0.2, 0.3, ((NO_COLUMN, NO_COLUMN), (1 if faulty else NO_COLUMN, NO_COLUMN)))
    assert likelihood(together, 1) == pytest.approx(norm.pdf(1.5, H @ mean, np.sqrt(S)))
    got_mean, got_cov = unpacked(together["m"][:, 1])
    np.testing.assert_allclose(got_mean, mean + K * (1.5 - H @ mean), rtol=1e-10)
    np.testing.assert_allclose(got_cov, cov - np.outer(K, H @ cov), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("sensor", [0, 1])
def test_an_offset_set_from_a_reading_is_a_diffuse_one(sensor: int) -> None:
    """The limit of an update with an offset of no prior knowledge, a variance of 1e8."""
    m = random_filter(np.random.default_rng(2))
    mean, cov = unpacked(m)
    cov[3:, :] = cov[:, 3:] = 0.0
    mean[3:] = 0.0
    cov[3, 3] = 1e8
    together = beside(packed(mean, cov), m)
    update_scalar(together, sensor, 3.0, 0.2, 0.3, ((1, NO_COLUMN), (0, NO_COLUMN)))
    set_offset(together["m"], 1, sensor, 3.0, 0.2)
    np.testing.assert_allclose(together["m"][:, 1], together["m"][:, 0], atol=1e-5)


def test_an_excluded_reading_has_heavy_tails_and_changes_nothing() -> None:
    m = random_filter(np.random.default_rng(3))
    mean, cov = unpacked(m)
    for z in (0.0, 1.0, 50.0):
        together = beside(m)
        update_scalar(together, 1, z, 0.2, 0.3, ((2, 5), (NO_COLUMN, NO_COLUMN)))
        expected = t.pdf(z, 2, mean[1], np.sqrt(cov[1, 1] + 0.2 + 0.3**2))
        for j in (2, 5):
            assert likelihood(together, j) == pytest.approx(expected)
            np.testing.assert_array_equal(together["m"][:, j], m)
        assert (together["m"][:, 3] != m).any()


def test_moment_matching_keeps_mean_and_covariance_of_the_mixture() -> None:
    rng = np.random.default_rng(4)
    a, b = random_filter(rng), random_filter(rng)
    (mean_a, cov_a), (mean_b, cov_b) = unpacked(a), unpacked(b)
    mean = 0.75 * mean_a + 0.25 * mean_b
    spread = [np.outer(d, d) for d in (mean_a - mean, mean_b - mean)]
    together = beside(a, b)["m"]
    assert moment_match_weighted(together, 0, 0.3, together, 1, 0.1) == pytest.approx(0.4)
    matched = unpacked(together[:, 0])
    np.testing.assert_allclose(matched[0], mean, rtol=1e-12)
    np.testing.assert_allclose(matched[1], 0.75 * (cov_a + spread[0]) + 0.25 * (cov_b + spread[1]), rtol=1e-10)


def test_a_share_too_small_to_matter_is_left_out() -> None:
    rng = np.random.default_rng(5)
    a, b = random_filter(rng), random_filter(rng)
    together = beside(a, b)["m"]
    assert moment_match_weighted(together, 0, 1.0, together, 1, 0.5 * WEIGHT_NEGLIGIBLE) == pytest.approx(1.0)
    np.testing.assert_array_equal(together[:, 0], a)


def test_a_covariance_that_rounding_has_broken_is_repaired_and_no_other_touched() -> None:
    good = random_filter(np.random.default_rng(6))
    broken = good.copy()
    broken[5], broken[10], broken[6] = 1.0, 1.0, 1.5
    together = beside(good, broken, good)
    assert repair_covariance(together)
    np.testing.assert_array_equal(together["m"][:, 0], good)
    assert np.linalg.eigvalsh(unpacked(together["m"][:, 1])[1]).min() > 0.0
    assert not repair_covariance(together)
