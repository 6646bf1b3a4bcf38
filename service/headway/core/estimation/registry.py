"""The motion models by name: the record of a row, the numbers, and the kernel that updates a row by a reading."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from headway.core.estimation import constant_acceleration as ca
from headway.core.estimation.car_following import IdmParams
from headway.core.estimation.delay_buffers import input_ring, slots
from headway.core.estimation.delayed_ekf import FilterParams, step_batch
from headway.core.estimation.imm import step
from headway.core.estimation.imm.sensor_quality import sensor_qualities
from headway.core.runtime.rows import BatchKernel, readings, verdicts
from headway.core.statistics.chi_square import chi_square_gate
from headway.core.statistics.fault_shape import EPISODE
from headway.core.types.config import MODEL_NAMES, DetectorConfig
from headway.core.types.records import Records
from headway.core.types.sensor_quality import SensorQualities

READINGS_PER_HOUR = 36_000
"""At the nominal 10 Hz of SAE J2945/1."""


@dataclass(frozen=True, slots=True)
class Model:
    """A model ready to run: `step_batch(bank, rows, readings, params, verdicts)` in place."""

    name: str
    dtype: np.dtype[np.void]
    params: Any
    step_batch: BatchKernel
    sensor_qualities: Callable[[Records], SensorQualities] | None = None
    """What the rows tell of the sensors; None for a model that learns nothing of them."""
    linear_algebra: bool = True
    """Whether `step_batch` may call BLAS or LAPACK."""

    def warm_up(self) -> None:
        """Compile or load `step_batch`.

        Processes that compile one kernel for different rows, such as rows of different delays, overwrite each other's
        cache. So call this before starting them.
        """
        no_rows = np.zeros(0, np.int64)
        self.step_batch(np.zeros(1, self.dtype), no_rows, readings(0), self.params, verdicts(0))


def paper_dtype(order: int, delay_s: float) -> np.dtype[np.void]:
    """Row of Model 1 (order 2) and Model 2 (order 3): state, covariance and delay buffers that reach back tau."""
    k, n = slots(delay_s), order
    return np.dtype(
        [
            ("count", "i8"),  # readings; 0: a row that is not initialised
            ("t_s", "f8"),  # event time of s and P
            ("rejections", "i8"),  # in a row, up to now
            ("episode", EPISODE),  # of the readings rejected in a row
            ("s", "f8", (n,)),
            ("P", "f8", (n, n)),
            ("own_count", "i8"),
            ("own_t", "f8", (k,)),
            ("own_s", "f8", (k, n)),
            ("own_P", "f8", (k, n, n)),
            *input_ring(delay_s),
        ],
        align=True,
    )


def paper_params(config: DetectorConfig) -> FilterParams:
    """Return Q, R and P0 as published (docs/PAPER.md), and the chi-square gates for the alarm budget."""
    false_alarm = min(0.5, config.alarm_budget_per_hour / READINGS_PER_HOUR)
    return FilterParams(
        idm=IdmParams(),
        delay_s=config.delay_s,
        delay_jitter_s=config.delay_jitter_s,
        gate=chi_square_gate(2, false_alarm),
        sensor_gate=chi_square_gate(1, false_alarm),
        # docs/PAPER.md, "Noise"; `rejections_max` is ours.
        q_x=0.5,
        q_v=0.3,
        q_delta=1e-2,
        r_x=0.01,
        r_v=0.01,
        p0=1.0,
        delta_limit_m=0.5,
        max_gap_s=config.max_gap_s,
        warming_readings=config.warming_readings,
        rejections_max=30,
    )


def _paper(name: str, order: int, config: DetectorConfig) -> Model:
    return Model(name, paper_dtype(order, config.delay_s), paper_params(config), step_batch)


def _headway(config: DetectorConfig) -> Model:
    dtype = step.headway_dtype(config.delay_s)
    return Model("headway", dtype, step.headway_params(config), step.step_batch, sensor_qualities, linear_algebra=False)


MODELS: dict[str, Callable[[DetectorConfig], Model]] = {
    "headway": _headway,
    "ca": lambda config: Model("ca", ca.CA, ca.ca_params(config), ca.step_batch, linear_algebra=False),
    "ekf": lambda config: _paper("ekf", 2, config),
    "aekf": lambda config: _paper("aekf", 3, config),
}


def register(name: str, build_model: Callable[[DetectorConfig], Model]) -> None:
    """Add a motion model, so that `DetectorConfig.model` may name it; an earlier one of that name is replaced."""
    MODELS[name] = build_model
    if name not in MODEL_NAMES:
        MODEL_NAMES.append(name)


def build(config: DetectorConfig) -> Model:
    """Return the model that `config` names; KeyError for an unknown name (settings refuse it earlier)."""
    return MODELS[config.model](config)
