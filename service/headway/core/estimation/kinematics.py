"""Kalman filters of one vehicle with an offset in one sensor, several filters side by side.

State of a filter: position x, speed v, acceleration a of the vehicle; offset b of the faulty sensor, and its slope s.
The motion is white jerk of density q (m^2/s^5), and the offset is a straight line in time:

    x' = v    v' = a    a' = jerk    b' = s    s' = 0

A filter is a column of an array m (SIZE, width). The rows are the five means and the upper triangle of the covariance,
by the names below. A loop over all columns becomes vector instructions if the width is part of the type, so such
functions take the record that holds m (`filters`). Eight columns fill the vector registers.
Measurement updates are scalar, one sensor after the other (Bar-Shalom, Li and Kirubarajan 2001, Estimation with
Applications to Tracking and Navigation, section 7.2), so a faulty sensor can be left out.
"""

from math import exp, pi, sqrt
from typing import Any

import numpy as np
from numba import njit

PX, VX, AX, OFFSET, SLOPE = range(5)
XX, XV, XA, XB, XS, VV, VA, VB, VS, AA, AB, AS, BB, BS, SS = range(5, 20)
SIZE = 20

Z_POSITION, Z_SPEED = 0, 1
"""Indices of a reading z = [x, v]."""
NO_COLUMN = -1
Roles = tuple[tuple[int, int], tuple[int, int]]
NO_ROLES: Roles = ((NO_COLUMN, NO_COLUMN), (NO_COLUMN, NO_COLUMN))
"""For `update_scalar`: every column uses the reading, without an offset."""
VARIANCE_FLOOR = 1e-6
"""Least variance after a repair, m^2, (m/s)^2 or (m/s^2)^2: a millimetre squared is below any sensor."""
WEIGHT_NEGLIGIBLE = 1e-9
"""Share of a mixture below which a component is left out."""
TWO_PI = 2.0 * pi


def filters(width: int) -> np.dtype[np.void]:
    """Return the record of `width` filters; `density` and `exponent` hold the likelihood of their readings."""
    return np.dtype([("m", "f8", (SIZE, width)), ("density", "f8", (width,)), ("exponent", "f8", (width,))])


@njit(cache=True, error_model="numpy")
def initialise(m: Any, j: int, x_m: float, v_mps: float, r_x: float, r_v: float, a_var: float) -> None:
    """Initialise column j at a reading of variances `r_x`, `r_v`, with no acceleration and no offset."""
    m[:, j] = 0.0
    m[PX, j], m[VX, j] = x_m, v_mps
    m[XX, j], m[VV, j], m[AA, j] = r_x, r_v, a_var


@njit(cache=True, error_model="numpy")
def copy_column(m: Any, into: int, other: Any, j: int) -> None:
    """Overwrite column `into` of m by column j of `other`."""
    for i in range(SIZE):
        m[i, into] = other[i, j]


@njit(cache=True, error_model="numpy")
def clear_offset(m: Any, j: int) -> None:
    """Remove the offset of column j."""
    for i in (OFFSET, SLOPE, XB, XS, VB, VS, AB, AS, BB, BS, SS):
        m[i, j] = 0.0


@njit(cache=True, error_model="numpy")
def add_jerk_noise(m: Any, j: int, dt_s: float, q: float) -> None:
    """Add the process noise of white jerk of density `q` over `dt_s` to column j.

    Q = q [[h^5/20, h^4/8, h^3/6], [h^4/8, h^3/3, h^2/2], [h^3/6, h^2/2, h]]      (Bar-Shalom et al. 2001, 6.2.3)
    """
    h = dt_s
    m[XX, j] += q * h**5 / 20.0
    m[XV, j] += q * h**4 / 8.0
    m[XA, j] += q * h**3 / 6.0
    m[VV, j] += q * h**3 / 3.0
    m[VA, j] += q * h**2 / 2.0
    m[AA, j] += q * h


@njit(cache=True, error_model="numpy")
def add_speed_jump(m: Any, j: int, dt_s: float, v_var: float) -> None:
    """Add a jump of the speed of variance `v_var` in the middle of `dt_s` to column j; a is unknown after it."""
    m[XX, j] += 0.25 * dt_s**2 * v_var
    m[XV, j] += 0.5 * dt_s * v_var
    m[VV, j] += v_var
    m[AA, j] += v_var / dt_s


@njit(cache=True, error_model="numpy")
def predict(filters: Any, dt_s: float, q: float, random_walk_density: float) -> None:
    """Predict every column by `dt_s`: m = F m, P = F P F' + Q, with F the exact solution of the equations above.

    `random_walk_density` (m^2/s): the position wanders against the integral of the speed, as satellite positions do.
    """
    m = filters.m
    h, g = dt_s, 0.5 * dt_s**2
    q_xx, q_xv, q_xa = q * h**5 / 20.0 + random_walk_density * dt_s, q * h**4 / 8.0, q * h**3 / 6.0
    q_vv, q_va, q_aa = q * h**3 / 3.0, q * h**2 / 2.0, q * h
    for j in range(m.shape[1]):
        m[PX, j] += h * m[VX, j] + g * m[AX, j]
        m[VX, j] += h * m[AX, j]
        m[OFFSET, j] += h * m[SLOPE, j]
        # F P, row by row ...
        xx = m[XX, j] + h * m[XV, j] + g * m[XA, j]
        xv = m[XV, j] + h * m[VV, j] + g * m[VA, j]
        xa = m[XA, j] + h * m[VA, j] + g * m[AA, j]
        xb = m[XB, j] + h * m[VB, j] + g * m[AB, j]
        xs = m[XS, j] + h * m[VS, j] + g * m[AS, j]
        vv = m[VV, j] + h * m[VA, j]
        va = m[VA, j] + h * m[AA, j]
        vb = m[VB, j] + h * m[AB, j]
        vs = m[VS, j] + h * m[AS, j]
        bb = m[BB, j] + h * m[BS, j]
        bs = m[BS, j] + h * m[SS, j]
        # ... and then F P F' + Q.
        m[XX, j] = xx + h * xv + g * xa + q_xx
        m[XV, j] = xv + h * xa + q_xv
        m[XA, j] = xa + q_xa
        m[XB, j] = xb + h * xs
        m[XS, j] = xs
        m[VV, j] = vv + h * va + q_vv
        m[VA, j] = va + q_va
        m[VB, j] = vb + h * vs
        m[VS, j] = vs
        m[AA, j] += q_aa
        m[AB, j] += h * m[AS, j]
        m[BB, j] = bb + h * bs
        m[BS, j] = bs


@njit(cache=True, error_model="numpy")
def reset_likelihood(filters: Any) -> None:
    """Set the likelihood of every column to 1."""
    for j in range(filters.density.size):
        filters.density[j], filters.exponent[j] = 1.0, 0.0


@njit(cache=True, error_model="numpy")
def update_scalar(filters: Any, sensor: int, z: float, r: float, spread: float, roles: Roles) -> None:
    """Update every column by one sensor's reading `z` of variance `r`, and multiply its likelihood by the reading's.

    nu = z - H m    S = H P H' + r    K = P H' / S    m += K nu    P -= K S K'    likelihood N(nu; 0, S)

    `roles` holds two pairs of columns. Those of the first exclude the reading: it changes nothing, and its likelihood
    is Student's t with two degrees of freedom and squared scale H P H' + r + `spread`^2. For those of the second, the
    offset b is part of H m. NO_COLUMN is none.
    """
    m, density, exponent = filters.m, filters.density, filters.exponent
    excluded, faulty = roles
    x, v = (1.0, 0.0) if sensor == Z_POSITION else (0.0, 1.0)
    for j in range(m.shape[1]):
        used = 0.0 if j in excluded else 1.0
        b = 1.0 if j in faulty else 0.0
        off = z - (x * m[PX, j] + v * m[VX, j])
        nu = off - b * m[OFFSET, j]
        # A variance below zero would make the likelihood of no number, also where the reading is used.
        seen = max(x * m[XX, j] + v * m[VV, j], 0.0)
        hx = x * m[XX, j] + v * m[XV, j] + b * m[XB, j]
        hv = x * m[XV, j] + v * m[VV, j] + b * m[VB, j]
        ha = x * m[XA, j] + v * m[VA, j] + b * m[AB, j]
        hb = x * m[XB, j] + v * m[VB, j] + b * m[BB, j]
        hs = x * m[XS, j] + v * m[VS, j] + b * m[BS, j]
        # Rounding alone takes it below r: x and b may be uncertain by far more than their sum.
        var = x * hx + v * hv + b * hb + r
        var = max(var, r)
        w = used / var
        kx, kv, ka, kb, ks = w * hx, w * hv, w * ha, w * hb, w * hs
        m[PX, j] += kx * nu
        m[VX, j] += kv * nu
        m[AX, j] += ka * nu
        m[OFFSET, j] += kb * nu
        m[SLOPE, j] += ks * nu
        m[XX, j] -= kx * hx
        m[XV, j] -= kx * hv
        m[XA, j] -= kx * ha
        m[XB, j] -= kx * hb
        m[XS, j] -= kx * hs
        m[VV, j] -= kv * hv
        m[VA, j] -= kv * ha
        m[VB, j] -= kv * hb
        m[VS, j] -= kv * hs
        m[AA, j] -= ka * ha
        m[AB, j] -= ka * hb
        m[AS, j] -= ka * hs
        m[BB, j] -= kb * hb
        m[BS, j] -= kb * hs
        m[SS, j] -= ks * hs
        wide = seen + r + spread * spread
        c = 1.0 + 0.5 * off * off / wide
        density[j] *= used * sqrt(1.0 / (TWO_PI * var)) + (1.0 - used) * sqrt(0.125 / (wide * c)) / c
        exponent[j] += w * nu * nu


@njit(cache=True, error_model="numpy")
def set_offset(m: Any, j: int, sensor: int, z: float, r: float) -> None:
    """Set the offset of column j to b = z - h, of variance P + r, h being what `sensor` should read.

    This is the limit of an update with an offset of unbounded variance; the sensor must not have been used yet.
    """
    if sensor == Z_POSITION:
        m[OFFSET, j] = z - m[PX, j]
        m[XB, j], m[VB, j], m[AB, j], m[BB, j] = -m[XX, j], -m[XV, j], -m[XA, j], m[XX, j] + r
    else:
        m[OFFSET, j] = z - m[VX, j]
        m[XB, j], m[VB, j], m[AB, j], m[BB, j] = -m[XV, j], -m[VV, j], -m[VA, j], m[VV, j] + r
    for i in (SLOPE, XS, VS, AS, BS, SS):
        m[i, j] = 0.0


@njit(cache=True, error_model="numpy")
def likelihood(filters: Any, j: int) -> float:
    """Return the likelihood of the readings since `reset_likelihood` in column j."""
    return float(filters.density[j] * exp(-0.5 * filters.exponent[j]))


@njit(cache=True, error_model="numpy")
def repair_covariance(filters: Any) -> bool:
    """Make every covariance positive again, and return whether one was not; `density` is overwritten.

    Updates subtract, and rounding leaves no digits of a position that is a million metres off. A repaired covariance
    keeps its variances and loses its correlations.
    """
    m, least = filters.m, filters.density
    for j in range(m.shape[1]):
        xx, vv, aa, xv, xa, va = m[XX, j], m[VV, j], m[AA, j], m[XV, j], m[XA, j], m[VA, j]
        minor = xx * vv - xv * xv
        det = aa * minor - va * (xx * va - xv * xa) + xa * (xv * va - vv * xa)
        offset = min(m[BB, j], m[SS, j])
        least[j] = min(xx, minor, det, offset if offset < 0.0 else 1.0)
    repaired = False
    for j in range(m.shape[1]):
        if not least[j] > 0.0:
            repaired = True
            xx, vv, aa, bb, ss = m[XX, j], m[VV, j], m[AA, j], m[BB, j], m[SS, j]
            for i in range(XX, SIZE):
                m[i, j] = 0.0
            m[XX, j], m[VV, j], m[AA, j] = max(xx, VARIANCE_FLOOR), max(vv, VARIANCE_FLOOR), max(aa, VARIANCE_FLOOR)
            m[BB, j], m[SS, j] = max(bb, 0.0), max(ss, 0.0)
    return repaired


@njit(cache=True, error_model="numpy", inline="always")
def moment_match(m: Any, into: int, other: Any, j: int, f: float) -> None:
    """Replace column `into` by the Gaussian with the moments of (1 - f) `into` + f `other`[:, j].

    m = m_1 + f d    P = P_1 + f (P_2 - P_1) + f (1 - f) d d'    d = m_2 - m_1
    """
    g = f * (1.0 - f)
    dx, dv, da = other[PX, j] - m[PX, into], other[VX, j] - m[VX, into], other[AX, j] - m[AX, into]
    db, ds = other[OFFSET, j] - m[OFFSET, into], other[SLOPE, j] - m[SLOPE, into]
    m[PX, into] += f * dx
    m[VX, into] += f * dv
    m[AX, into] += f * da
    m[OFFSET, into] += f * db
    m[SLOPE, into] += f * ds
    m[XX, into] += f * (other[XX, j] - m[XX, into]) + g * dx * dx
    m[XV, into] += f * (other[XV, j] - m[XV, into]) + g * dx * dv
    m[XA, into] += f * (other[XA, j] - m[XA, into]) + g * dx * da
    m[XB, into] += f * (other[XB, j] - m[XB, into]) + g * dx * db
    m[XS, into] += f * (other[XS, j] - m[XS, into]) + g * dx * ds
    m[VV, into] += f * (other[VV, j] - m[VV, into]) + g * dv * dv
    m[VA, into] += f * (other[VA, j] - m[VA, into]) + g * dv * da
    m[VB, into] += f * (other[VB, j] - m[VB, into]) + g * dv * db
    m[VS, into] += f * (other[VS, j] - m[VS, into]) + g * dv * ds
    m[AA, into] += f * (other[AA, j] - m[AA, into]) + g * da * da
    m[AB, into] += f * (other[AB, j] - m[AB, into]) + g * da * db
    m[AS, into] += f * (other[AS, j] - m[AS, into]) + g * da * ds
    m[BB, into] += f * (other[BB, j] - m[BB, into]) + g * db * db
    m[BS, into] += f * (other[BS, j] - m[BS, into]) + g * db * ds
    m[SS, into] += f * (other[SS, j] - m[SS, into]) + g * ds * ds


@njit(cache=True, error_model="numpy")
def moment_match_weighted(m: Any, into: int, weight: float, other: Any, j: int, weight_j: float) -> float:
    """Moment match column `into`, of `weight`, with column j of `other`, of `weight_j`; return the sum of both."""
    total = weight + weight_j
    if weight_j > WEIGHT_NEGLIGIBLE * total:
        moment_match(m, into, other, j, weight_j / total)
    return total
