"""Eigenvalues of small symmetric matrices. LAPACK from within a kernel needs SciPy, larger than the whole service."""

import math
from typing import Any

import numpy as np
from numba import njit

_SWEEPS = 12
"""Jacobi's method converges quadratically: four sweeps reach the last digit of a 3 by 3 matrix."""


@njit(cache=True, error_model="numpy")
def raise_eigenvalues(P: Any, least: float) -> None:
    """Raise the eigenvalues of a symmetric P (n, n) to at least `least`, in place; its eigenvectors stay.

    Cyclic Jacobi rotations (Golub and Van Loan, Matrix Computations, 8.5).
    """
    n = P.shape[0]
    vectors = np.eye(n)
    for _ in range(_SWEEPS):
        for p in range(n - 1):
            for q in range(p + 1, n):
                if P[p, q] == 0.0:
                    continue
                tau = (P[q, q] - P[p, p]) / (2.0 * P[p, q])
                t = math.copysign(1.0, tau) / (abs(tau) + math.sqrt(1.0 + tau * tau))
                c = 1.0 / math.sqrt(1.0 + t * t)
                for k in range(n):
                    P[k, p], P[k, q] = c * (P[k, p] - t * P[k, q]), c * (t * P[k, p] + P[k, q])
                for k in range(n):
                    P[p, k], P[q, k] = c * (P[p, k] - t * P[q, k]), c * (t * P[p, k] + P[q, k])
                for k in range(n):
                    vectors[k, p], vectors[k, q] = (
                        c * (vectors[k, p] - t * vectors[k, q]),
                        c * (t * vectors[k, p] + vectors[k, q]),
                    )
    values = np.empty(n)
    for k in range(n):
        values[k] = max(P[k, k], least)
    for a in range(n):
        for b in range(n):
            P[a, b] = 0.0
            for k in range(n):
                P[a, b] += values[k] * vectors[a, k] * vectors[b, k]
