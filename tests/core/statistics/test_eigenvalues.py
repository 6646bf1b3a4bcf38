"""Against LAPACK."""

import numpy as np
import pytest

from headway.core.statistics.eigenvalues import raise_eigenvalues


@pytest.mark.parametrize("n", [2, 3])
def test_low_eigenvalues_are_raised_and_the_rest_stays(n: int) -> None:
    rng = np.random.default_rng(n)
    for _ in range(300):
        scale = np.exp(rng.normal(0.0, 6.0, n))
        P = rng.normal(size=(n, n))
        P = scale[:, None] * (P + P.T) * scale
        values, vectors = np.linalg.eigh(P)
        expected = (vectors * np.maximum(values, 1e-3)) @ vectors.T
        raise_eigenvalues(P, 1e-3)
        assert np.abs(P - expected).max() <= 1e-12 * np.abs(values).max() + 1e-15


@pytest.mark.parametrize("P", [np.diag([-1.0, 2.0, 0.0]), np.zeros((2, 2)), np.diag([1e-300, 1e300])])
def test_a_diagonal_needs_no_rotation(P: np.ndarray) -> None:
    expected = np.diag(np.maximum(np.diag(P), 0.5))
    raise_eigenvalues(P, 0.5)
    assert (expected == P).all()
