"""The normalised innovation squared of two readings taken together, in a form that rounding cannot make negative.

S = P + R is the covariance of the innovations nu_x, nu_v; P is that of the prediction, and R is diagonal. By the Schur
complement of S_xx (Golub and Van Loan, Matrix Computations, section 4.2):

    S_v|x = S_vv - S_xv^2 / S_xx
    nis   = nu' S^-1 nu = nu_x^2 / S_xx + (nu_v - S_xv / S_xx nu_x)^2 / S_v|x

P is positive semidefinite, so S_v|x is at least R_vv. The determinant S_xx S_vv - S_xv^2 has no such floor: rounding
takes it to zero, or below, where the position nearly determines the speed.
"""

from typing import NamedTuple

from numba import njit


class Innovation(NamedTuple):
    """Innovation of position and speed, its covariance S, and nis."""

    nu_x: float
    nu_v: float
    s_xx: float
    s_xv: float
    s_vv: float
    nis: float


@njit(cache=True, error_model="numpy")
def conditional_variance(s_xx: float, s_xv: float, s_vv: float, r_v: float) -> float:
    """Return S_v|x, the variance of the speed's innovation given the position's: at least `r_v`, the speed's own."""
    return max(s_vv - s_xv**2 / s_xx, r_v)


@njit(cache=True, error_model="numpy")
def nis_2d(nu_x: float, nu_v: float, s_xx: float, s_xv: float, s_vv: float, r_v: float) -> float:
    """Return nu' S^-1 nu; `r_v` is the variance of a speed reading, which bounds S_v|x from below."""
    return nu_x**2 / s_xx + (nu_v - s_xv / s_xx * nu_x) ** 2 / conditional_variance(s_xx, s_xv, s_vv, r_v)
