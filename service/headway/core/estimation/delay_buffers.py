"""Delay buffers: the estimate, its covariance and the input, tau seconds ago.

A row may hold two rings, contiguous with its state. `own_*` holds (t, s, P), and `input_*` holds (t, u), with u the
position of the leader's rear and its speed. Linear interpolation gives the past that the method of steps needs.
Another leader leaves the past unchanged, because the driver followed the former one then.
"""

from math import ceil
from typing import Any

from numba import njit

SPACING_S = 0.08
"""Least distance of two entries, s: all messages of a nominal sender are stored (100 ms, jitter 5 ms)."""

SPARE = 4
"""Entries beyond the delay: the newest one, its neighbours for interpolation, and jitter."""


def slots(delay_s: float) -> int:
    """Return how many entries a ring needs to reach back `delay_s`."""
    return SPARE + ceil(delay_s / SPACING_S)


def input_ring(delay_s: float) -> list[tuple[str, str] | tuple[str, str, tuple[int, ...]]]:
    """Return the fields of a record whose ring of inputs reaches back `delay_s`."""
    k = slots(delay_s)
    return [("input_count", "i8"), ("input_t", "f8", (k,)), ("input_u", "f8", (k, 2))]


@njit(cache=True, error_model="numpy")
def _slot(times: Any, count: int) -> int:
    """Return the index of a new entry: the newest one's own if that is too close to the one before it.

    So entries are `SPACING_S` apart except for the newest, and `slots` of them reach back at any message rate.
    """
    size = times.size
    if count >= 2 and times[(count - 1) % size] - times[(count - 2) % size] < SPACING_S:
        return count - 1
    return count


@njit(cache=True, error_model="numpy")
def push_own(row: Any, t: float) -> None:
    """Store the row's present estimate as that of time `t`."""
    at = _slot(row.own_t, row.own_count)
    row.own_count = at + 1
    k = at % row.own_t.size
    row.own_t[k] = t
    row.own_s[k, :] = row.s
    row.own_P[k, :, :] = row.P


@njit(cache=True, error_model="numpy")
def push_input(row: Any, t: float, rear_x_m: float, v_mps: float) -> None:
    """Store the leader's sample under its own event time; one that is not newer is ignored."""
    if row.input_count > 0 and t <= row.input_t[(row.input_count - 1) % row.input_t.size]:
        return
    at = _slot(row.input_t, row.input_count)
    row.input_count = at + 1
    k = at % row.input_t.size
    row.input_t[k] = t
    row.input_u[k, 0] = rear_x_m
    row.input_u[k, 1] = v_mps


@njit(cache=True, error_model="numpy")
def bracket(times: Any, count: int, t: float) -> tuple[int, int, float]:
    """Return slots (i, j) of the entries around `t` and the weight of j; i == j outside the ring."""
    size = times.size
    j = (count - 1) % size
    if t >= times[j]:
        return j, j, 0.0
    for _ in range(min(count, size) - 1):
        i = j - 1 if j > 0 else size - 1
        if times[i] <= t:
            return i, j, (t - times[i]) / (times[j] - times[i])
        j = i
    return j, j, 0.0


@njit(cache=True, error_model="numpy")
def own_at(row: Any, t: float, s: Any, P: Any) -> None:
    """Write estimate and covariance of time `t` into the first n of `s` and `P`.

    Before the first entry the vehicle has its first speed; after the newest, the newest entry holds.
    """
    i, j, w = bracket(row.own_t, row.own_count, t)
    n = row.s.size
    for a in range(n):
        s[a] = (1.0 - w) * row.own_s[i, a] + w * row.own_s[j, a]
        for b in range(n):
            P[a, b] = (1.0 - w) * row.own_P[i, a, b] + w * row.own_P[j, a, b]
    if t < row.own_t[i]:
        s[0] -= s[1] * (row.own_t[i] - t)


@njit(cache=True, error_model="numpy")
def input_at(row: Any, t: float) -> tuple[float, float, float]:
    """Return (position of the leader's rear, v_leader, a_leader) at time `t`; NaN without a leader.

    Outside the ring the leader keeps its speed. a_leader is the slope of v_leader between the two entries around `t`.
    """
    if row.input_count == 0:
        return float("nan"), float("nan"), float("nan")
    i, j, w = bracket(row.input_t, row.input_count, t)
    if i == j:
        x, v = row.input_u[i, 0], row.input_u[i, 1]
        return x + v * (t - row.input_t[i]), v, 0.0
    x = (1.0 - w) * row.input_u[i, 0] + w * row.input_u[j, 0]
    v = (1.0 - w) * row.input_u[i, 1] + w * row.input_u[j, 1]
    a = (row.input_u[j, 1] - row.input_u[i, 1]) / (row.input_t[j] - row.input_t[i])
    return x, v, a
