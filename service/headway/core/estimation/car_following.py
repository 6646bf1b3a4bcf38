"""Intelligent Driver Model: acceleration of a follower behind its leader, and its gradient.

Source: Treiber, Hennecke, Helbing 2000 (doi:10.1103/PhysRevE.62.1805), as used by Wang, Masoud, Khojandi 2020
(arXiv:2004.09496), equation `idm`:

    f_v = a (1 - (v / v0)^delta - (s* / d)^2)
    s*  = s0 + v T + v (v - v_leader) / (2 sqrt(a b))
    d   = x_leader - x - l

Without a leader the last term of f_v is absent (free road).
"""

from math import isnan, sqrt
from typing import NamedTuple

from numba import njit

GAP_FLOOR_M = 0.5
"""Least gap, m: estimates of two vehicles may overlap, vehicles do not."""

BRAKING_LIMIT_MPS2 = -9.81
"""Hardest braking, m/s^2: a friction coefficient of 1. It keeps f_v finite as a gap closes."""


class IdmParams(NamedTuple):
    """The driver; defaults are those of Wang, Masoud, Khojandi 2020."""

    a_mps2: float = 1.0
    """Largest acceleration, m/s^2."""
    b_mps2: float = 1.5
    """Comfortable braking, m/s^2."""
    delta: float = 4.0
    """Exponent of the acceleration on a free road."""
    v0_mps: float = 33.75
    """Desired speed, m/s."""
    s0_m: float = 2.0
    """Gap at standstill, m."""
    T_s: float = 1.0
    """Desired time gap, s."""


@njit(cache=True, error_model="numpy")
def power(base: float, exponent: float) -> float:
    """Return base ** exponent; two products for the usual exponent 4, where the library takes a third of `idm`."""
    square = base * base
    return square * square if exponent == 4.0 else float(base**exponent)


@njit(cache=True, error_model="numpy")
def idm(gap_m: float, v_mps: float, v_leader_mps: float, p: IdmParams) -> tuple[float, float, float, float]:
    """Return f_v and its gradient (df/dx, df/dv, df/dv_leader), in m/s^2 per m and per m/s; df/dx_leader = -df/dx.

    `gap_m` is d; NaN means a free road. Beyond a limit (least gap, hardest braking) the gradient is that of the limited
    function, which is zero in the limited direction.
    """
    a = p.a_mps2
    v = max(v_mps, 0.0)
    free = power(v / p.v0_mps, p.delta)
    f = a * (1.0 - free)
    df_dv = -a * p.delta * free / v if v > 0.0 else 0.0
    if isnan(gap_m):
        return f, 0.0, df_dv, 0.0
    d = max(gap_m, GAP_FLOOR_M)
    c = 1.0 / (2.0 * sqrt(a * p.b_mps2))
    s_star = p.s0_m + v * p.T_s + v * (v - v_leader_mps) * c
    near = s_star / d
    f -= a * near * near
    if f < BRAKING_LIMIT_MPS2:
        return BRAKING_LIMIT_MPS2, 0.0, 0.0, 0.0
    slope = 2.0 * a * near / d
    df_dx = -slope * near if gap_m > GAP_FLOOR_M else 0.0
    if v > 0.0:
        df_dv -= slope * (p.T_s + (2.0 * v - v_leader_mps) * c)
    return f, df_dx, df_dv, slope * v * c
