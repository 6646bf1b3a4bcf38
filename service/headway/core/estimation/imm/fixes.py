"""Which messages hold a position that was measured for them: neither repeated, nor one interval late."""

from math import sqrt
from typing import Any

from numba import njit

from headway.core.estimation.imm.modes import HEALTHY
from headway.core.estimation.kinematics import AX, PX, VV, VX, XX

FIX_INTERVAL_MAX_S = 1.2
"""Receivers have a fix at least once a second. A position that is repeated for longer counts as measured again."""
UNCHANGED_M = 0.05
"""A position that should have changed by less is measured again where it was: most have a resolution of centimetres."""
STANDING_MPS = 0.5
"""Speed below which a vehicle may stand, so that its messages repeat themselves."""
REPEAT_GAIN = 0.02
"""Share of the newest message in the share of repeated positions."""
SLOW_SHARE = 0.3
"""Share of repeated positions from which a receiver is slower than its messages."""
LATE_SHARE = 0.03
"""Share of repeated positions from which a position may also come one message too late."""
LATE_MAX_S = 3.0
"""So long in a row: two seconds are seen in New York (ADR 0011). For longer it is an offset."""
LATE_STD = 3.0
"""Standard deviations of a position that half of its way in an interval exceeds, so that noise is never late."""
INTERVAL_GROWTH = 1.05
"""Factor by which the interval of repeated positions may grow with each, so that a lost message is forgotten."""


@njit(cache=True, error_model="numpy")
def repeats_position(row: Any, z: Any) -> bool:
    """Whether the receiver has had no new fix since its last one; call it once for each READING."""
    calibration, since_s = row.calibration, z.t_s - row.last_t_s
    unchanged = row.count > 0 and z.east_m == 0.0 and z.north_m == 0.0
    row.position_unchanged_s = row.position_unchanged_s + since_s if unchanged else 0.0
    slow = calibration.repeat_share > SLOW_SHARE
    unchanged = unchanged and (slow or z.v_mps * row.position_unchanged_s > UNCHANGED_M)
    row.last_t_s = z.t_s
    if z.v_mps > STANDING_MPS:
        calibration.repeat_share += REPEAT_GAIN * ((1.0 if unchanged else 0.0) - calibration.repeat_share)
        if unchanged:
            known = calibration.repeat_interval_s > 0.0
            longest_s = INTERVAL_GROWTH * calibration.repeat_interval_s if known else FIX_INTERVAL_MAX_S
            calibration.repeat_interval_s = min(since_s, longest_s)
    if row.position_unchanged_s > FIX_INTERVAL_MAX_S:
        row.position_unchanged_s = 0.0
        return False
    return bool(unchanged)


@njit(cache=True, error_model="numpy")
def is_late(row: Any, x_m: float, dt_s: float, variance: float) -> bool:
    """Whether the position `x_m`, of `variance`, is that of one interval before, of a receiver that repeats positions.

    Call it once for each position that is not repeated.
    """
    calibration, single = row.calibration, row.single
    repeats = LATE_SHARE < calibration.repeat_share < SLOW_SHARE
    v_mps = single[VX, HEALTHY]
    half_m = 0.5 * v_mps * calibration.repeat_interval_s
    std_m = sqrt(variance + single[XX, HEALTHY] + dt_s**2 * single[VV, HEALTHY])
    behind_m = single[PX, HEALTHY] + dt_s * v_mps + 0.5 * dt_s**2 * single[AX, HEALTHY] - x_m
    if repeats and half_m > LATE_STD * std_m and half_m < behind_m < 3.0 * half_m and row.late_s < LATE_MAX_S:
        row.late_s += dt_s
        return True
    row.late_s = 0.0
    return False
