"""The result of one step of the engine."""

import math
from dataclasses import dataclass, field
from enum import StrEnum, unique
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import F64, I64, Ids
from headway.core.types.identifiers import ID
from headway.core.types.records import READING, VERDICT, Kind, Records, Sensor


@unique
class Phase(StrEnum):
    """The life of an event."""

    ONSET = "onset"
    UPDATE = "update"
    CLEARED = "cleared"


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """The input that reproduces a verdict: a row's state some readings ago, and each reading since.

    `checkpoint` is the bank row (`Detectors.dtype`) before `readings[0]`. `readings` (n,) has dtype READING, oldest
    first. `leaders` (n,) is the row of the leader at each reading, -1 for none; only a change of the number matters.
    """

    checkpoint: Records
    readings: Records
    leaders: I64


@dataclass(frozen=True, slots=True, kw_only=True)
class AnomalyEvent:
    """An event update about one suspect; `event_id` is the same from onset to cleared."""

    event_id: str
    phase: Phase
    kind: Kind
    sensor: Sensor
    confidence: float
    suspect: str
    leader: str | None
    follower: str
    t_us: int
    """Event time of the reading that caused this update."""
    onset_us: int
    """That of the first update."""
    received_us: int
    detected_us: int
    """Receive time that had come when it was found."""
    nis: float = math.nan
    """This and the next are those of the reading; NaN for an update without one: a miss, or a vehicle that left."""
    gate: float = math.nan
    statistic: float = math.nan
    p_value: float = math.nan
    nu: tuple[float, float] = (math.nan, math.nan)
    """Innovation of location (m) and speed (m/s)."""
    recovered: tuple[float, float, float, float] = (math.nan, math.nan, math.nan, math.nan)
    """x_m, v_mps, x_std_m, v_std_mps of the estimate that replaces the reading."""
    deviation: tuple[float, float] = (0.0, 0.0)
    """Largest |reading - estimate| of location (m) and speed (m/s) until now; zeros for an event of the link."""
    observations: tuple[str, ...] = ()
    """Physical limits that the vehicle's messages break now: labels of `Observation`."""
    evidence: Evidence | None = None
    """None where there is no reading."""


@dataclass(frozen=True, slots=True, kw_only=True)
class StepResult:
    """Result of `Engine.step`."""

    outcomes: NDArray[np.uint8]
    """(B,) an `Outcome` for each record, in the batch's order."""
    events: list[AnomalyEvent] = field(default_factory=list)
    nis: F64 = field(default_factory=lambda: np.empty(0))
    """nis of the scored readings, for the consistency metric."""
    anomalous: int = 0
    """Scored readings with a statistic above the gate."""
    sequence_gaps: int = 0
    """Messages lost before those of this step, by the senders' counters."""
    repairs: int = 0
    restarts: int = 0
    evicted: int = 0
    leader_changes: int = 0
    resets: int = 0
    """Filters initialised again because their numbers were not finite."""
    failures: list["RoundFailure"] = field(default_factory=list)


class RoundFailure(NamedTuple):
    """An exception of a round: a defect of the detector. Its records have the outcome DETECTOR_FAILED."""

    error: str
    records: list[dict[str, object]]
    """Input of the first of them, to reproduce it."""


class RecordVerdicts(NamedTuple):
    """(B,) what was found of each record of a batch, in its order; zeros and no leader where it was rejected."""

    verdicts: Records
    """Of VERDICT: of the filter, or of the pair tests where they alone find a fault of this vehicle."""
    readings: Records
    """Of READING."""
    leader_ids: Ids
    """Whom each vehicle followed; empty for nobody."""

    @classmethod
    def empty(cls, count: int) -> Self:
        """Return room for `count` records."""
        return cls(np.zeros(count, VERDICT), np.zeros(count, READING), np.zeros(count, ID))


@dataclass(slots=True)
class StepTally:
    """The sums of a step in progress; the fields are those of `StepResult`."""

    events: list[AnomalyEvent] = field(default_factory=list)
    nis: list[F64] = field(default_factory=list)
    anomalous: int = 0
    sequence_gaps: int = 0
    repairs: int = 0
    restarts: int = 0
    evicted: int = 0
    leader_changes: int = 0
    resets: int = 0
    failures: list[RoundFailure] = field(default_factory=list)

    def result(self, outcomes: NDArray[np.uint8]) -> StepResult:
        """Return the sums as a result; `outcomes` (B,)."""
        return StepResult(
            outcomes=outcomes,
            events=self.events,
            nis=np.concatenate([np.empty(0), *self.nis]),
            anomalous=self.anomalous,
            sequence_gaps=self.sequence_gaps,
            repairs=self.repairs,
            restarts=self.restarts,
            evicted=self.evicted,
            leader_changes=self.leader_changes,
            resets=self.resets,
            failures=self.failures,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class PairStates:
    """The state of vehicles as columns, for the state topic and queries."""

    followers: list[str]
    leaders: list[str | None]
    t_us: NDArray[np.int64]
    lat_deg: F64
    lon_deg: F64
    heading_deg: F64
    gap_m: F64
    x_m: F64
    offset_m: F64
    """Location of the newest reading less the estimate; NaN without one."""
    v_mps: F64
    statistic: F64
    gate: F64
    nis: F64
    warming: NDArray[np.bool_]
    anomalous: NDArray[np.bool_]
    silent: NDArray[np.bool_]
