"""The normalised innovation squared against a linear solver, and where a determinant would fail."""

import numpy as np
import pytest

from headway.core.statistics.innovation import conditional_variance, nis_2d


def test_nis_is_the_quadratic_form_of_the_inverse() -> None:
    rng = np.random.default_rng(0)
    for _ in range(100):
        root, r = rng.normal(size=(2, 2)), rng.uniform(0.01, 1.0, 2)
        S = root @ root.T + np.diag(r)
        nu = rng.normal(size=2)
        expected = nu @ np.linalg.solve(S, nu)
        assert nis_2d(nu[0], nu[1], S[0, 0], S[0, 1], S[1, 1], r[1]) == pytest.approx(expected, rel=1e-9)


def test_the_conditional_variance_is_that_of_the_inverse() -> None:
    S = np.array([[2.0, 0.7], [0.7, 1.5]])
    assert conditional_variance(2.0, 0.7, 1.5, 0.1) == pytest.approx(1.0 / np.linalg.inv(S)[1, 1])


def test_nis_stays_positive_and_finite_where_the_determinant_vanishes() -> None:
    """P of rank one and far larger than R: rounding leaves a determinant of 0, and the exact S_v|x is 2 R."""
    p, r, apart = 1e15, 1e-4, 1e-2
    s_xx, s_xv, s_vv = p + r, p, p + r
    assert s_xx * s_vv - s_xv**2 == 0.0
    assert nis_2d(1.0, 1.0 + apart, s_xx, s_xv, s_vv, r) == pytest.approx(apart**2 / r, rel=1e-6)
