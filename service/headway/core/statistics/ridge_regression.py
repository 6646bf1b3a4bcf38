"""Recursive ridge regression with forgetting, in information form: y = theta' phi + noise.

    A <- f A + w phi phi'       b <- f b + w y phi       theta = (A + ridge I)^-1 (b + ridge prior)

f is the forgetting factor and w the sample's weight. The ridge is added when solving and is not forgotten. So columns
without excitation, as at a steady speed, return to the prior, where a covariance form would wind up.
A is packed: its lower triangle row by row, n (n + 1) / 2 numbers.
"""

from math import sqrt
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy")
def ridge_learn(A: Any, b: Any, phi: Any, y: float, forget: float, weight: float) -> None:
    """Add one sample to A (n (n + 1) / 2,) and b (n,), in place."""
    at = 0
    for row in range(b.size):
        weighted = weight * phi[row]
        for column in range(row + 1):
            A[at] = forget * A[at] + weighted * phi[column]
            at += 1
        b[row] = forget * b[row] + weighted * y


@njit(cache=True, error_model="numpy")
def ridge_solve(A: Any, b: Any, ridge: float, prior: Any, theta: Any) -> None:
    """Write theta (n,) by a Cholesky factorisation of A + ridge I; `ridge` above 0, `prior` (n,) or a tuple."""
    n = b.size
    L = np.empty(A.size)
    for row in range(n):
        at = row * (row + 1) // 2
        for column in range(row):
            above = column * (column + 1) // 2
            rest = A[at + column]
            for k in range(column):
                rest -= L[at + k] * L[above + k]
            L[at + column] = rest / L[above + column]
        rest, right = A[at + row] + ridge, b[row] + ridge * prior[row]
        for k in range(row):
            rest -= L[at + k] ** 2
            right -= L[at + k] * theta[k]
        L[at + row] = sqrt(max(rest, ridge * 1e-9))
        theta[row] = right / L[at + row]
    for row in range(n - 1, -1, -1):
        rest = theta[row]
        for k in range(row + 1, n):
            rest -= L[k * (k + 1) // 2 + row] * theta[k]
        theta[row] = rest / L[row * (row + 1) // 2 + row]
