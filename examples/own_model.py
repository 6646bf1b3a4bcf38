"""A motion model of your own: one file and one registration.

Run `python examples/own_model.py`. The model is an alpha-beta filter: it predicts by constant speed, and corrects
location and speed by fixed shares of the innovation. Bar-Shalom, Li, Kirubarajan: Estimation with Applications to
Tracking and Navigation, section 6.5.
"""

from typing import Any, NamedTuple

import numpy as np
from numba import njit
from scipy.special import chdtri

from headway import Detector, sample_recording
from headway.core.estimation.registry import READINGS_PER_HOUR, Model, register
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Kind, Sensor

ROW = np.dtype([("count", "i8"), ("t_s", "f8"), ("x_m", "f8"), ("v_mps", "f8")], align=True)
"""What is stored of a vehicle. A row of zeros is a vehicle without a message."""
NOISE, LOCATION, SPEED, BOTH = int(Kind.NOISE), int(Sensor.LOCATION), int(Sensor.SPEED), int(Sensor.BOTH)


class Params(NamedTuple):
    """The numbers of the model."""

    gate: float
    warming_readings: int
    max_gap_s: float
    alpha: float = 0.5
    beta: float = 0.4
    std_x_m: float = 0.15
    std_v_mps: float = 0.35
    """Spread of the innovations at 10 Hz, braking included."""


@njit(cache=True, error_model="numpy")
def step_row(row: Any, z: Any, p: Params, verdict: Any) -> None:
    """Update one row with one reading, and write the verdict."""
    dt_s = z.t_s - row.t_s
    if row.count == 0 or dt_s > p.max_gap_s:
        row.count, row.x_m, row.v_mps, dt_s = 0, z.x_m, z.v_mps, 0.0
    x_m, v_mps = row.x_m + row.v_mps * dt_s, row.v_mps
    nu_x, nu_v = z.x_m - x_m, z.v_mps - v_mps
    in_x, in_v = (nu_x / p.std_x_m) ** 2, (nu_v / p.std_v_mps) ** 2
    verdict.nis = verdict.statistic = in_x + in_v
    verdict.gate, verdict.p_value = p.gate, np.exp(-0.5 * verdict.nis)
    verdict.warming = row.count < p.warming_readings
    verdict.anomalous = not verdict.warming and verdict.nis > p.gate
    verdict.nu[0], verdict.nu[1] = nu_x, nu_v
    verdict.S[0, 0], verdict.S[1, 1] = p.std_x_m**2, p.std_v_mps**2
    row.count, row.t_s, row.x_m, row.v_mps = row.count + 1, z.t_s, x_m, v_mps
    if verdict.anomalous:
        verdict.kind, verdict.confidence = NOISE, 0.5
        verdict.sensor = BOTH if min(in_x, in_v) > 0.5 * p.gate else (LOCATION if in_x > in_v else SPEED)
    else:
        row.x_m, row.v_mps = x_m + p.alpha * nu_x, v_mps + p.beta * nu_v
    verdict.x_m, verdict.v_mps = row.x_m, row.v_mps
    verdict.x_std_m, verdict.v_std_mps = p.std_x_m, p.std_v_mps


@njit(cache=True, error_model="numpy")
def step_batch(bank: Any, rows: Any, readings: Any, p: Params, verdicts: Any) -> None:
    """Update the distinct `rows` (B,) of the bank with `readings` and `verdicts` (B,)."""
    for i in range(rows.size):
        step_row(bank[rows[i]], readings[i], p, verdicts[i])


def build(config: DetectorConfig) -> Model:
    """Return the model with the numbers that a configuration asks for."""
    gate = float(chdtri(2, config.alarm_budget_per_hour / READINGS_PER_HOUR))
    return Model("alpha-beta", ROW, Params(gate, config.warming_readings, config.max_gap_s), step_batch)


register("alpha-beta", build)


def main() -> None:
    """Judge the sample recording with the new model."""
    detector = Detector(model="alpha-beta")
    for event in detector.process(sample_recording()).events:
        print(event.phase, event.sensor, event.suspect, event.model)


if __name__ == "__main__":
    main()
