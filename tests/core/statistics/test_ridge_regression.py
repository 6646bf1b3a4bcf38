import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.statistics.ridge_regression import ridge_learn, ridge_solve

N = 4


def learnt(phi: np.ndarray, y: np.ndarray, forget: float, ridge: float, prior: np.ndarray) -> np.ndarray:
    A, b, theta = np.zeros(N * (N + 1) // 2), np.zeros(N), np.zeros(N)
    for row, value in zip(phi, y, strict=True):
        ridge_learn(A, b, row, value, forget, 1.0)
    ridge_solve(A, b, ridge, prior, theta)
    return theta


@pytest.mark.parametrize("forget", [1.0, 0.97])
def test_one_sample_at_a_time_is_least_squares_on_all_of_them(forget: float) -> None:
    """Stacking sqrt(ridge) (theta - prior) under the weighted rows makes the ridge a plain least-squares problem."""
    rng = np.random.default_rng(1)
    phi, y, prior, ridge = rng.normal(size=(200, N)), rng.normal(size=200), rng.normal(size=N), 3.0
    weight = np.sqrt(forget ** np.arange(199, -1, -1))
    rows = np.vstack([weight[:, None] * phi, np.sqrt(ridge) * np.eye(N)])
    batch = np.linalg.lstsq(rows, np.concatenate([weight * y, np.sqrt(ridge) * prior]), rcond=None)[0]
    assert learnt(phi, y, forget, ridge, prior) == pytest.approx(batch, rel=1e-9, abs=1e-9)


def test_what_is_never_excited_stays_at_the_prior() -> None:
    phi = np.zeros((500, N))
    phi[:, 0] = 1.0
    theta = learnt(phi, np.full(500, 2.0), 0.9, 1.0, np.array([0.0, 5.0, -1.0, 0.5]))
    assert theta[1:] == pytest.approx([5.0, -1.0, 0.5])
    assert theta[0] == pytest.approx(2.0, rel=0.1)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(1e-3, 1e3), st.floats(-6, 6))
def test_collinear_columns_give_finite_coefficients(seed: int, ridge: float, magnitude: float) -> None:
    rng = np.random.default_rng(seed)
    phi = np.outer(rng.normal(size=50), rng.normal(size=N)) * 10.0**magnitude
    assert np.isfinite(learnt(phi, rng.normal(size=50), 0.99, ridge, np.zeros(N))).all()
