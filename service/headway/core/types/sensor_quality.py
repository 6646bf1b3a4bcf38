"""What is known of the sensors of vehicles, and how good that makes them."""

from dataclasses import dataclass, fields
from enum import IntEnum, unique

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import F64


@unique
class QualityLevel(IntEnum):
    """How much can be told from the readings of a vehicle."""

    GOOD = 0
    DEGRADED = 1
    """An ordinary receiver with a defect: small faults hide in it."""
    UNUSABLE = 2
    """Only large faults would show, or the readings break a physical limit now."""

    @property
    def label(self) -> str:
        """The name on the wire."""
        return self.name.lower()


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorQualities:
    """Learnt properties of the sensors of n vehicles, (n,) each; NaN: not known yet."""

    position_noise_m: F64
    """Standard deviation of a position at rest."""
    position_wander_mps: F64
    """Root of the random-walk density of the position, m per root second."""
    position_age_s: F64
    """How much older positions are than speeds."""
    repeated_share: F64
    """Share of the messages in motion that repeat the last position."""
    speed_noise_mps: F64
    speed_bias_mps: F64
    """Speed over ground less the reported one, in motion."""
    speed_scale: F64
    """The same as a share of the speed."""
    speed_step_mps: F64
    """Step in which speeds are reported."""
    clock_jitter_s: F64
    """Scatter of the time stamps."""

    def of(self, chosen: NDArray[np.bool_]) -> "SensorQualities":
        """Return those of the chosen (n,) vehicles."""
        return SensorQualities(**{field.name: getattr(self, field.name)[chosen] for field in fields(self)})


GOOD_LIMITS = {
    "position_noise_m": 0.5,
    "position_wander_mps": 0.5,
    "position_age_s": 0.1,
    "repeated_share": 0.02,
    "speed_noise_mps": 0.1,
    "speed_bias_mps": 0.2,
    "speed_scale": 0.015,
    "speed_step_mps": 0.12,
    "clock_jitter_s": 0.01,
}
"""Sizes up to which a sensor is good: a GNSS receiver in the open with a Doppler speed."""

USABLE_LIMITS = {
    "position_noise_m": 3.0,
    "position_wander_mps": 3.0,
    "position_age_s": 0.7,
    "repeated_share": 0.95,
    "speed_noise_mps": 1.0,
    "speed_bias_mps": 1.0,
    "speed_scale": 0.049,
    "speed_step_mps": 0.45,
    "clock_jitter_s": 0.1,
}
"""Sizes beyond which it is unusable: the limits of what receivers are, at which learning stops."""


def quality_levels(qualities: SensorQualities, observed: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (n,) of `QualityLevel`; `observed` (n,) are the physical limits that the readings break now, as flags."""
    levels = np.where(observed != 0, int(QualityLevel.UNUSABLE), int(QualityLevel.GOOD))
    for field in fields(qualities):
        size = np.abs(getattr(qualities, field.name))
        levels = np.maximum(levels, np.where(size > GOOD_LIMITS[field.name], int(QualityLevel.DEGRADED), 0))
        levels = np.maximum(levels, np.where(size > USABLE_LIMITS[field.name], int(QualityLevel.UNUSABLE), 0))
    return levels


@dataclass(frozen=True, slots=True, kw_only=True)
class QualityStates:
    """Vehicles whose sensors are known, as columns."""

    vehicles: list[str]
    t_us: NDArray[np.int64]
    levels: NDArray[np.int64]
    """Of `QualityLevel`."""
    qualities: SensorQualities
