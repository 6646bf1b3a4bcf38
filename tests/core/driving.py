"""A smooth drive of one car as READINGs, and the default model along it."""

import numpy as np
from numba import njit

from headway.core.estimation.imm.step import headway_dtype, headway_params, step_row
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

NOISE = 0.01


def drive(rng, n=900, x_std=NOISE, v_std=NOISE):
    """A car between 8 and 16 m/s at 10 Hz; readings with white noise, and the true (x, v)."""
    t_s = 0.1 * np.arange(n)
    v = 12.0 + 2.5 * np.sin(0.2 * t_s) + 1.5 * np.sin(0.53 * t_s + 1.0)
    x = np.r_[0.0, np.cumsum(0.05 * (v[1:] + v[:-1]))]
    read = readings(n)
    read["t_s"], read["x_m"], read["v_mps"] = t_s, x + rng.normal(0, x_std, n), v + rng.normal(0, v_std, n)
    return read, x, v


@njit
def along(row, read, p, results):
    for k in range(read.size):
        step_row(row, read[k], p, results[k])


def run_model(read, row=None, **config):
    """Return the verdicts of a drive, and the row after it."""
    settled = DetectorConfig(**config)
    bank = np.zeros(1, headway_dtype(settled.delay_s)) if row is None else row
    results = verdicts(len(read))
    along(bank[0], read, headway_params(settled), results)
    return results, bank
