"""Kalman filters for one car whose one sensor may lie by an offset, several of them side by side.

State of a filter: location x, speed v, acceleration a of the car; offset b of the sensor that lies, and its slope s.
Motion is exact in x' = v, with white jerk of density q (m^2/s^5); a lie is a straight line in time:

    x' = v    v' = a    a' = jerk    b' = s    s' = 0

Filters are columns ("lanes") of an array m (SIZE, width), whose rows are the five means and the upper triangle of the
covariance, by the names below: what is done to all lanes alike is a loop that the compiler turns into vector
instructions. For that the width must be part of the type, so such functions take the record that holds m (`filters`);
eight lanes fill a register, and what they are computed with is in the same record or a scalar.
Sensors are taken one after the other (scalar updates), so that a bad one can be left out.
"""

from math import exp, sqrt
from typing import Any

import numpy as np
from numba import njit

PX, VX, AX, OFFSET, SLOPE = range(5)
XX, XV, XA, XB, XS, VV, VA, VB, VS, AA, AB, AS, BB, BS, SS = range(5, 20)
SIZE = 20

Z_POSITION, Z_SPEED = 0, 1
NO_COLUMN = -1
VARIANCE_FLOOR = 1e-6
WEIGHT_NEGLIGIBLE = 1e-9
"""Share of a mixture that leaves no trace in it."""
TWO_PI = 6.283185307179586


def filters(width: int) -> np.dtype[np.void]:
    """Return the record of `width` filters; `density` and `exponent` say how likely readings were (`likelihood`)."""
    return np.dtype([("m", "f8", (SIZE, width)), ("density", "f8", (width,)), ("exponent", "f8", (width,))])


@njit(cache=True, error_model="numpy")
def initialise(m: Any, j: int, x_m: float, v_mps: float, r_x: float, r_v: float, a_var: float) -> None:
    """Start lane j at a reading with variances `r_x`, `r_v`, at rest in a, without a lie."""
    m[:, j] = 0.0
    m[PX, j], m[VX, j] = x_m, v_mps
    m[XX, j], m[VV, j], m[AA, j] = r_x, r_v, a_var


@njit(cache=True, error_model="numpy")
def copy_column(m: Any, into: int, other: Any, j: int) -> None:
    """Overwrite lane `into` of m by lane j of `other`."""
    for i in range(SIZE):
        m[i, into] = other[i, j]


@njit(cache=True, error_model="numpy")
def clear_offset(m: Any, j: int) -> None:
    """Take the lie out of lane j."""
    for i in (OFFSET, SLOPE, XB, XS, VB, VS, AB, AS, BB, BS, SS):
        m[i, j] = 0.0


@njit(cache=True, error_model="numpy")
def add_jerk_noise(m: Any, j: int, dt_s: float, q: float) -> None:
    """Add what white jerk of density `q` does to the covariance of lane j in `dt_s`."""
    h = dt_s
    m[XX, j] += q * h**5 / 20.0
    m[XV, j] += q * h**4 / 8.0
    m[XA, j] += q * h**3 / 6.0
    m[VV, j] += q * h**3 / 3.0
    m[VA, j] += q * h**2 / 2.0
    m[AA, j] += q * h


@njit(cache=True, error_model="numpy")
def add_speed_jump(m: Any, j: int, dt_s: float, v_var: float) -> None:
    """Add a jump of the speed somewhere within `dt_s`, on average in its middle; a is as good as unknown after it."""
    m[XX, j] += 0.25 * dt_s**2 * v_var
    m[XV, j] += 0.5 * dt_s * v_var
    m[VV, j] += v_var
    m[AA, j] += v_var / dt_s


@njit(cache=True, error_model="numpy")
def predict(filters: Any, dt_s: float, q: float, random_walk_density: float) -> None:
    """Carry every lane on by `dt_s`: m = F m, P = F P F' + Q, with F the exact solution of the equations above.

    `random_walk_density` (m^2/s): the location wanders against the integral of the speed, as satellite positions do.
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
    """Forget how likely earlier readings were."""
    for j in range(filters.density.size):
        filters.density[j], filters.exponent[j] = 1.0, 0.0


@njit(cache=True, error_model="numpy")
def update_scalar(
    filters: Any,
    sensor: int,
    z: float,
    r: float,
    spread: float,
    excluded: int,
    excluded_too: int,
    faulty: int,
    faulty_too: int,
) -> None:
    """Update every lane by one sensor's reading `z` of variance `r`, and note how likely it was.

    In the columns `excluded` and `excluded_too` the reading changes nothing: it is Student's t with two degrees of
    freedom, whose scale is `spread` on top of what state and sensor leave open, and whose tails forgive any size.
    In the columns `faulty` and `faulty_too` the offset b is in the reading. NO_COLUMN is none.
    """
    m, density, exponent = filters.m, filters.density, filters.exponent
    x, v = (1.0, 0.0) if sensor == Z_POSITION else (0.0, 1.0)
    for j in range(m.shape[1]):
        u = 0.0 if j in (excluded, excluded_too) else 1.0
        lie = 1.0 if j in (faulty, faulty_too) else 0.0
        off = z - (x * m[PX, j] + v * m[VX, j])
        nu = off - lie * m[OFFSET, j]
        seen = x * m[XX, j] + v * m[VV, j]
        hx = x * m[XX, j] + v * m[XV, j] + lie * m[XB, j]
        hv = x * m[XV, j] + v * m[VV, j] + lie * m[VB, j]
        ha = x * m[XA, j] + v * m[VA, j] + lie * m[AB, j]
        hb = x * m[XB, j] + v * m[VB, j] + lie * m[BB, j]
        hs = x * m[XS, j] + v * m[VS, j] + lie * m[BS, j]
        # Never below r but for rounding: x and b may be known to the digit in their sum and to a hundred metres apart.
        var = x * hx + v * hv + lie * hb + r
        var = max(var, r)
        w = u / var
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
        density[j] *= u * sqrt(1.0 / (TWO_PI * var)) + (1.0 - u) * sqrt(0.125 / (wide * c)) / c
        exponent[j] += w * nu * nu


@njit(cache=True, error_model="numpy")
def set_offset(m: Any, j: int, sensor: int, z: float, r: float) -> None:
    """Let `sensor`, not yet used at this instant, lie by exactly what its reading `z` differs, of variance P + r."""
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
    """Return how likely the readings since `reset_likelihood` were in lane j."""
    return float(filters.density[j] * exp(-0.5 * filters.exponent[j]))


@njit(cache=True, error_model="numpy")
def repair_covariance(filters: Any) -> bool:
    """Make every lane's covariance positive again; return whether one was not. Takes the room of `density`.

    Updates subtract, and a location a million metres off leaves no digits. What is known is then only kept to the
    size of the variances: correlations are dropped.
    """
    m, least = filters.m, filters.density
    for j in range(m.shape[1]):
        xx, vv, aa, xv, xa, va = m[XX, j], m[VV, j], m[AA, j], m[XV, j], m[XA, j], m[VA, j]
        minor = xx * vv - xv * xv
        det = aa * minor - va * (xx * va - xv * xa) + xa * (xv * va - vv * xa)
        lies = min(m[BB, j], m[SS, j])
        least[j] = min(xx, minor, det, lies if lies < 0.0 else 1.0)
    mended = False
    for j in range(m.shape[1]):
        if not least[j] > 0.0:
            mended = True
            xx, vv, aa, bb, ss = m[XX, j], m[VV, j], m[AA, j], m[BB, j], m[SS, j]
            for i in range(XX, SIZE):
                m[i, j] = 0.0
            m[XX, j], m[VV, j], m[AA, j] = max(xx, VARIANCE_FLOOR), max(vv, VARIANCE_FLOOR), max(aa, VARIANCE_FLOOR)
            m[BB, j], m[SS, j] = max(bb, 0.0), max(ss, 0.0)
    return mended


@njit(cache=True, error_model="numpy", inline="always")
def moment_match(m: Any, into: int, other: Any, j: int, f: float) -> None:
    """Make lane `into` of m the one Gaussian for a mixture: a share `f` of lane j of `other`, the rest of itself."""
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
    """Fold lane j of `other`, of weight `weight_j`, into lane `into` of m, of `weight`; return the sum of both."""
    total = weight + weight_j
    if weight_j > WEIGHT_NEGLIGIBLE * total:
        moment_match(m, into, other, j, weight_j / total)
    return total
