"""One hypothesis about one vehicle: a Kalman filter for a car whose one sensor may lie by an offset.

State of a hypothesis, m = [x, v, a, b, s]: location, speed, acceleration of the car; offset b of the sensor that lies
and its slope s. Motion is exact in x' = v, with white jerk of density q (m^2/s^5); a lie is a straight line in time:

    x' = v    v' = a    a' = jerk    b' = s    s' = 0

A row of SIZE floats holds the five means and the upper triangle of their covariance, by the names below. Sensors are
taken one after the other (scalar updates), so that a bad one can be left out.
"""

from math import exp, sqrt
from typing import Any

from numba import njit

X, V, A, B, S = range(5)
XX, XV, XA, XB, XS, VV, VA, VB, VS, AA, AB, AS, BB, BS, SS = range(5, 20)
SIZE = 20

LOCATION, SPEED = 0, 1
VARIANCE_FLOOR = 1e-6
NEGLIGIBLE = 1e-9
"""Share of a mixture that leaves no trace in it."""
TAU = 6.283185307179586


@njit(cache=True)
def copy(into: Any, m: Any) -> None:
    """Overwrite a hypothesis by another."""
    for i in range(SIZE):
        into[i] = m[i]


@njit(cache=True)
def copy_honest(into: Any, m: Any) -> None:
    """Overwrite a hypothesis by another without its lie."""
    copy(into, m)
    into[B], into[S] = 0.0, 0.0
    into[XB], into[XS], into[VB], into[VS], into[AB], into[AS] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    into[BB], into[BS], into[SS] = 0.0, 0.0, 0.0


@njit(cache=True)
def begin(m: Any, x_m: float, v_mps: float, r_x: float, r_v: float, a_var: float) -> None:
    """Start at a reading with variances `r_x`, `r_v`, at rest in a, without a lie."""
    m[:] = 0.0
    m[X], m[V] = x_m, v_mps
    m[XX], m[VV], m[AA] = r_x, r_v, a_var


@njit(cache=True)
def jolt(m: Any, dt_s: float, q: float) -> None:
    """Add what white jerk of density `q` does to the covariance in `dt_s`."""
    h = dt_s
    m[XX] += q * h**5 / 20.0
    m[XV] += q * h**4 / 8.0
    m[XA] += q * h**3 / 6.0
    m[VV] += q * h**3 / 3.0
    m[VA] += q * h**2 / 2.0
    m[AA] += q * h


@njit(cache=True)
def jump(m: Any, dt_s: float, v_var: float) -> None:
    """Add a jump of the speed somewhere within `dt_s`, on average in its middle; a is as good as unknown after it."""
    m[XX] += 0.25 * dt_s**2 * v_var
    m[XV] += 0.5 * dt_s * v_var
    m[VV] += v_var
    m[AA] += v_var / dt_s


@njit(cache=True)
def predict(m: Any, dt_s: float, q: float, walk: float) -> None:
    """Carry m on by `dt_s`: m = F m, P = F P F' + Q, with F the exact solution of the equations above.

    `walk` (m^2/s) is how the location strays from the integral of the speed: reported ones do, by satellite.
    """
    h, g = dt_s, 0.5 * dt_s**2
    m[X] += h * m[V] + g * m[A]
    m[V] += h * m[A]
    m[B] += h * m[S]
    # F P, row by row ...
    xx = m[XX] + h * m[XV] + g * m[XA]
    xv = m[XV] + h * m[VV] + g * m[VA]
    xa = m[XA] + h * m[VA] + g * m[AA]
    xb = m[XB] + h * m[VB] + g * m[AB]
    xs = m[XS] + h * m[VS] + g * m[AS]
    vv = m[VV] + h * m[VA]
    va = m[VA] + h * m[AA]
    vb = m[VB] + h * m[AB]
    vs = m[VS] + h * m[AS]
    bb = m[BB] + h * m[BS]
    bs = m[BS] + h * m[SS]
    # ... and then F P F'.
    m[XX] = xx + h * xv + g * xa
    m[XV] = xv + h * xa
    m[XA] = xa
    m[XB] = xb + h * xs
    m[XS] = xs
    m[VV] = vv + h * va
    m[VA] = va
    m[VB] = vb + h * vs
    m[VS] = vs
    m[AB] += h * m[AS]
    m[BB] = bb + h * bs
    m[BS] = bs
    m[XX] += walk * dt_s
    jolt(m, dt_s, q)


@njit(cache=True)
def observe(m: Any, sensor: int, lying: bool, z: float, r: float) -> float:
    """Update m by one sensor's reading `z` of variance `r`; `lying`: its offset b is in it. Return the likelihood."""
    if sensor == LOCATION:
        nu = z - m[X]
        hx, hv, ha, hb, hs = m[XX], m[XV], m[XA], m[XB], m[XS]
    else:
        nu = z - m[V]
        hx, hv, ha, hb, hs = m[XV], m[VV], m[VA], m[VB], m[VS]
    if lying:
        nu -= m[B]
        hx += m[XB]
        hv += m[VB]
        ha += m[AB]
        hb += m[BB]
        hs += m[BS]
    # Never below r but for rounding: x and b may be known to the digit in their sum and to a hundred metres apart.
    var = max((hx if sensor == LOCATION else hv) + (hb if lying else 0.0) + r, r)
    w = 1.0 / var
    kx, kv, ka, kb, ks = w * hx, w * hv, w * ha, w * hb, w * hs
    m[X] += kx * nu
    m[V] += kv * nu
    m[A] += ka * nu
    m[B] += kb * nu
    m[S] += ks * nu
    m[XX] -= kx * hx
    m[XV] -= kx * hv
    m[XA] -= kx * ha
    m[XB] -= kx * hb
    m[XS] -= kx * hs
    m[VV] -= kv * hv
    m[VA] -= kv * ha
    m[VB] -= kv * hb
    m[VS] -= kv * hs
    m[AA] -= ka * ha
    m[AB] -= ka * hb
    m[AS] -= ka * hs
    m[BB] -= kb * hb
    m[BS] -= kb * hs
    m[SS] -= ks * hs
    return float(exp(-0.5 * nu * nu * w) * sqrt(w / TAU))


@njit(cache=True)
def accuse(m: Any, sensor: int, z: float, r: float) -> None:
    """Let `sensor`, not yet used at this instant, lie by exactly what its reading `z` differs, of variance P + r."""
    if sensor == LOCATION:
        m[B] = z - m[X]
        m[XB], m[VB], m[AB], m[BB] = -m[XX], -m[XV], -m[XA], m[XX] + r
    else:
        m[B] = z - m[V]
        m[XB], m[VB], m[AB], m[BB] = -m[XV], -m[VV], -m[VA], m[VV] + r
    m[S], m[XS], m[VS], m[AS], m[BS], m[SS] = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0


@njit(cache=True)
def disregard(m: Any, sensor: int, z: float, r: float, spread: float) -> float:
    """Return the likelihood of a reading that means nothing: Student's t with two degrees of freedom.

    Its scale is `spread` on top of what the state and the sensor leave open; its tails forgive any size.
    """
    if sensor == LOCATION:
        nu, var = z - m[X], m[XX] + r
    else:
        nu, var = z - m[V], m[VV] + r
    var += spread**2
    u = 1.0 + 0.5 * nu * nu / var
    return float(1.0 / (2.0 * sqrt(2.0 * var) * u * sqrt(u)))


@njit(cache=True)
def mend(m: Any) -> bool:
    """Make the covariance positive again where rounding has not left it so; return whether that was needed.

    Updates subtract, and a location a million metres off leaves no digits. What is known is then only kept to the
    size of the variances: correlations are dropped.
    """
    xx, vv, aa = m[XX], m[VV], m[AA]
    minor = xx * vv - m[XV] ** 2
    det = aa * minor - m[VA] * (xx * m[VA] - m[XV] * m[XA]) + m[XA] * (m[XV] * m[VA] - vv * m[XA])
    if xx > 0.0 and minor > 0.0 and det > 0.0 and m[BB] >= 0.0 and m[SS] >= 0.0:
        return False
    bb, ss = m[BB], m[SS]
    m[XX:] = 0.0
    m[XX], m[VV], m[AA] = max(xx, VARIANCE_FLOOR), max(vv, VARIANCE_FLOOR), max(aa, VARIANCE_FLOOR)
    m[BB], m[SS] = max(bb, 0.0), max(ss, 0.0)
    return True


@njit(cache=True)
def merge(m: Any, weight: float, other: Any, weight_other: float) -> float:
    """Fold `other` into m, keeping mean and covariance of the mixture; return the sum of the weights."""
    total = weight + weight_other
    if weight_other <= NEGLIGIBLE * total:
        return total
    f = weight_other / total
    g = f * (1.0 - f)
    dx, dv, da, db, ds = other[X] - m[X], other[V] - m[V], other[A] - m[A], other[B] - m[B], other[S] - m[S]
    for i in range(SIZE):
        m[i] += f * (other[i] - m[i])
    m[XX] += g * dx * dx
    m[XV] += g * dx * dv
    m[XA] += g * dx * da
    m[XB] += g * dx * db
    m[XS] += g * dx * ds
    m[VV] += g * dv * dv
    m[VA] += g * dv * da
    m[VB] += g * dv * db
    m[VS] += g * dv * ds
    m[AA] += g * da * da
    m[AB] += g * da * db
    m[AS] += g * da * ds
    m[BB] += g * db * db
    m[BS] += g * db * ds
    m[SS] += g * ds * ds
    return total


@njit(cache=True)
def blend(M: Any, weights: Any, into: Any) -> float:
    """Write mean and covariance of the car's own motion over hypotheses M (k, SIZE) into `into`, without any lie.

    Return the sum of `weights` (k,); when it is 0, `into` is left as it is.
    """
    total = 0.0
    for j in range(weights.size):
        total += weights[j]
    if total <= 0.0:
        return total
    x, v, a = 0.0, 0.0, 0.0
    for j in range(weights.size):
        f = weights[j] / total
        x += f * M[j, X]
        v += f * M[j, V]
        a += f * M[j, A]
    xx, xv, xa, vv, va, aa = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(weights.size):
        f = weights[j] / total
        dx, dv, da = M[j, X] - x, M[j, V] - v, M[j, A] - a
        xx += f * (M[j, XX] + dx * dx)
        xv += f * (M[j, XV] + dx * dv)
        xa += f * (M[j, XA] + dx * da)
        vv += f * (M[j, VV] + dv * dv)
        va += f * (M[j, VA] + dv * da)
        aa += f * (M[j, AA] + da * da)
    into[:] = 0.0
    into[X], into[V], into[A] = x, v, a
    into[XX], into[XV], into[XA], into[VV], into[VA], into[AA] = xx, xv, xa, vv, va, aa
    return total
