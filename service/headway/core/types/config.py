"""What an operator decides about detection, as one frozen value. Settings make it; the core only reads it."""

from dataclasses import dataclass, field, fields
from typing import Any, Final


def _parameter(default: Any, description: str) -> Any:
    """Declare a field; `description` is what `headway config schema` and the operations guide print."""
    return field(default=default, metadata={"description": description})


MODEL_NAMES: Final = ["ekf", "aekf", "headway"]
"""Motion models that can be configured; `registry.register` adds to them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """Every number that changes a verdict. Two equal configs give bit-equal verdicts on equal input.

    A number given for a `float` becomes one: kernels are compiled for each type that they meet.
    """

    model: str = _parameter("headway", "Motion model that predicts each reading: a name of the model registry.")
    delay_s: float = _parameter(
        0.5, "Age at which the leader's action reaches the follower's response (tau), 0 to 5 s."
    )
    delay_jitter_s: float = _parameter(
        0.0, "Standard deviation of that delay (sigma_1); only `ekf` and `aekf` use it, as input noise."
    )
    alarm_budget_per_hour: float = _parameter(1.0, "False alarms accepted on clean traffic, per vehicle and hour.")
    vehicle_capacity: int = _parameter(
        10_000, "Vehicles known at once (rows of every table); a further one is rejected as `table_full`."
    )
    vehicle_ttl_s: float = _parameter(
        30.0, "Silence after which a vehicle is evicted; senders change their ids every few minutes."
    )
    max_age_s: float = _parameter(5.0, "Event time this far behind the receipt is rejected as `too_old`.")
    max_ahead_s: float = _parameter(1.0, "Event time this far ahead of the receipt is rejected as `from_the_future`.")
    max_gap_s: float = _parameter(5.0, "Silence after which a vehicle's filter is initialised again.")
    warming_readings: int = _parameter(
        30, "Readings of a vehicle before its verdicts count; the filter adapts its noise meanwhile."
    )
    silence_timeout_s: float = _parameter(
        0.6, "Silence that never counts as a miss; congestion control may stretch the interval to 0.6 s (SAE J2945/1)."
    )
    lane_width_m: float = _parameter(
        3.6, "Lane width; a leader is searched within half of it to either side of a vehicle's path."
    )
    pairing_range_m: float = _parameter(150.0, "Distance ahead within which a leader is searched.")
    evidence_readings: int = _parameter(32, "Readings kept of each vehicle to replay a verdict from, a multiple of 4.")

    def __post_init__(self) -> None:
        for parameter in fields(self):
            if isinstance(parameter.default, float):
                object.__setattr__(self, parameter.name, float(getattr(self, parameter.name)))
