"""What an operator decides about detection, as one frozen value. Settings make it; the core only reads it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorConfig:
    """Every number that changes a verdict. Two equal configs give bit-equal verdicts on equal input."""

    model: str = "headway"
    """Motion model: a name of `models.MODELS`."""

    delay_s: float = 0.5
    """tau, the age at which the leader's action reaches the follower's response; 0 to 5 s."""

    delay_jitter_s: float = 0.0
    """sigma_1 of the stochastic delay, entering as input noise; only `ekf` and `aekf` use it."""

    alarm_budget_per_hour: float = 1.0
    """False alarms the operator accepts, per vehicle and hour of clean traffic."""

    vehicle_capacity: int = 10_000
    """Rows of every table: vehicles known at once. A further one is refused as `table_full`."""

    forget_after_s: float = 30.0
    """A vehicle not heard for so long is forgotten (ids rotate: V2X senders change theirs every few minutes)."""

    max_age_s: float = 5.0
    """A record whose event time lies further back than this is refused as `too_old`."""

    max_ahead_s: float = 1.0
    """A record whose event time lies further ahead than this is refused as `from_the_future`."""

    max_gap_s: float = 5.0
    """After so long a silence of one sender its filter starts anew."""

    warming_readings: int = 30
    """Readings of a vehicle before its verdicts count: three seconds at 10 Hz, in which its noise is learnt."""

    miss_after_s: float = 0.6
    """Silence never counts as a miss before this: congestion control may stretch the interval so far (SAE J2945/1)."""

    lane_width_m: float = 3.6
    """Half of it, to either side of a vehicle's path, is where its leader may be."""

    pairing_range_m: float = 150.0
    """How far ahead a leader is looked for."""

    evidence_readings: int = 32
    """Readings kept for each vehicle to replay a verdict from."""
