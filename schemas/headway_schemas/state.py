"""Reports of the service: the state of a pair, its health, and copies of rejected messages."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import Field

from headway_schemas.fields import Blob, Id, Message, Number, TUs

Count = Annotated[int, Field(ge=0)]
Label = Annotated[str, Field(pattern="^[a-z][a-z0-9_]{0,63}$")]
"""A name from a closed set of the service, such as a reason."""


class Standing(StrEnum):
    """State of a pair by its newest reading."""

    NORMAL = "normal"
    WARMING = "warming"
    ANOMALOUS = "anomalous"
    SILENT = "silent"
    """No reading for longer than the sender's own interval explains."""


class PairState(Message):
    """A follower and its leader, as of its newest reading."""

    site: Id
    follower: Id
    leader: Id | None = None
    """Null on a free road."""
    t_us: TUs
    standing: Standing
    lat: Number = None
    lon: Number = None
    heading_deg: Number = None
    gap_m: Number = None
    x_m: Number = None
    """Location along the follower's own path, as the filter estimates."""
    offset_m: Number = None
    """Location of the newest reading less that estimate."""
    v_mps: Number = None
    nis: Number = None
    statistic: Number = None
    gate: Number = None


class QualityLevel(StrEnum):
    """How much the readings of a vehicle show."""

    GOOD = "good"
    DEGRADED = "degraded"
    """Small faults hide in an ordinary defect of the receiver."""
    UNUSABLE = "unusable"
    """Only large faults show, or the readings break a physical limit now."""


class SensorQuality(Message):
    """What the detector has learnt of the sensors of a vehicle. It is a state, never an alarm."""

    site: Id
    vehicle: Id
    t_us: TUs
    level: QualityLevel
    position_noise_m: Number = None
    """Standard deviation of a position at rest."""
    position_wander_mps: Number = None
    """Root of the random-walk density of the position, m per root second."""
    position_age_s: Number = None
    """How much older positions are than speeds."""
    repeated_share: Number = None
    """Share of the messages in motion that repeat the last position."""
    speed_noise_mps: Number = None
    speed_bias_mps: Number = None
    """Speed over ground less the reported one, in motion."""
    speed_scale: Number = None
    """The same as a share of the speed."""
    speed_step_mps: Number = None
    """Step in which speeds are reported."""
    clock_jitter_s: Number = None
    """Scatter of the time stamps."""


class Health(Message):
    """One instance of the service, as it reports itself."""

    instance: Id
    site: Id
    t_us: TUs
    version: str
    model: str
    config_hash: str
    ready: bool
    uptime_s: Annotated[float, Field(ge=0.0)]
    vehicles: Count
    pairs: Count
    capacity: Count
    queue_depth: Count
    queue_limit: Count
    scored: Count
    warming: Count
    rejected: dict[Label, Count]
    lost: dict[Label, Count]
    events: Count
    latency_ms: Annotated[dict[Label, Number], Field(default_factory=dict)]
    """From receipt to outcome, by percentile: `p50`, `p99`, `p999`, `max`."""
    sequence_gap_messages: Count = 0
    """Messages missing by gaps in the counters of the senders (msg_cnt)."""
    histograms_us: Annotated[dict[Label, tuple[tuple[float, int], ...]], Field(default_factory=dict, strict=False)]
    """Records by latency since the start, for each stage: (upper edge of a bucket in microseconds, count)."""
    epoch: Annotated[int, Field(ge=1)] | None = None
    """Number of the publisher among the services of its site; a higher one replaces it. Null outside a fleet."""
    cpu_s: Number = None
    """Processor time that the process has used."""
    rss_mb: Number = None
    troubles: Annotated[tuple[str, ...], Field(strict=False)] = ()
    """What does not work although messages are processed, such as the journal; a line each."""


class RejectedCopy(Message):
    """A rejected message, the reason, and its payload up to the size limit."""

    reason: Label
    detail: str
    key: str
    sender: Id | None = None
    encoding: str
    size: Count
    """Bytes of the whole payload."""
    payload: Blob
    truncated: bool
    received_us: TUs
    count: Annotated[int, Field(ge=1)] = 1
    """Records that this copy stands for."""

    @classmethod
    def of(
        cls,
        *,
        reason: str,
        detail: str,
        key: str,
        sender: str | None,
        encoding: str,
        payload: bytes,
        received_us: int,
        payload_max: int,
        count: int = 1,
    ) -> Self:
        """Copy a rejected message, its payload cut at `payload_max` bytes."""
        return cls(
            reason=reason,
            detail=detail,
            key=key,
            sender=sender,
            encoding=encoding,
            size=len(payload),
            payload=payload[:payload_max],
            truncated=len(payload) > payload_max,
            received_us=received_us,
            count=count,
        )
