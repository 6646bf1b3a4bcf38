"""Drives of one car as READINGs for the plausibility checks, and what the checks say along them."""

import numpy as np
from numba import njit

from headway.core.plausibility.checks import check
from headway.core.plausibility.limits import Limits
from headway.core.plausibility.state import PLAUSIBILITY
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.records import Observation

LIMITS = Limits()


class Drive:
    """A drive on a road that bends: `t_s`, `east_m`, `north_m`, `v_mps`, `heading_deg`, all (n,)."""

    def __init__(self, rng, v_mps, turn_radps=0.0, step_s=0.1):
        n = len(v_mps)
        self.t_s = step_s * np.arange(n)
        course = rng.uniform(0, 2 * np.pi) + np.cumsum(np.broadcast_to(turn_radps, n)) * step_s
        self.v_mps = np.array(v_mps, float)
        self.east_m = np.cumsum(self.v_mps * np.sin(course)) * step_s
        self.north_m = np.cumsum(self.v_mps * np.cos(course)) * step_s
        self.heading_deg = np.degrees(course) % 360
        self.accuracy_m = np.full(n, np.nan)
        self.contradictions, self.overlapped, self.appeared = np.zeros(n), np.zeros(n), np.zeros(n)

    def readings(self):
        """Return the drive as it is now, as READING (n,)."""
        made = readings(len(self.t_s))
        made["t_s"], made["v_mps"], made["x_m"] = self.t_s, self.v_mps, 0.0
        made["east_m"], made["north_m"] = (
            np.diff(self.east_m, prepend=self.east_m[0]),
            np.diff(self.north_m, prepend=self.north_m[0]),
        )
        made["heading_deg"], made["accuracy_m"] = self.heading_deg, self.accuracy_m
        for name in ("contradictions", "overlapped", "appeared"):
            made[name] = getattr(self, name)
        return made

    def check(self):
        """Return the VERDICT of each message, as far as the checks write it."""
        made = self.readings()
        judged = verdicts(len(made))
        _along(np.zeros(1, PLAUSIBILITY)[0], made, LIMITS, judged)
        return judged


@njit
def _along(row, read, p, judged):
    for k in range(read.size):
        check(row, read[k], p, judged[k])


def observed(judged):
    """Return the labels of all that was observed."""
    return {one.label for one in Observation(int(np.bitwise_or.reduce(judged["observed"])))}


def cruise(rng, seconds=30.0, v_mps=15.0, noise_mps=0.02):
    """Return a straight drive at a steady speed whose sensor dithers."""
    n = int(10 * seconds)
    drive = Drive(rng, np.full(n, v_mps))
    drive.v_mps = np.round((drive.v_mps + rng.normal(0, noise_mps, n)) / 0.02) * 0.02
    return drive
