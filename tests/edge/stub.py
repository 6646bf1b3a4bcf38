"""A detector that says what it is told to."""

from dataclasses import fields

import numpy as np

from headway.core.types.batch import Batch
from headway.core.types.outcome import Outcome
from headway.core.types.records import READING, Kind, Sensor
from headway.core.types.sensor_quality import QualityStates, SensorQualities
from headway.core.types.step_result import AnomalyEvent, Evidence, PairStates, Phase, StepResult


class StubEngine:
    """Scores every record, unless `outcomes` or `events` hold something else for the next step."""

    def __init__(self, vehicles: int = 0) -> None:
        self.vehicles = vehicles
        self.pairs = 0
        self.active_events = 0
        self.open_event_ids: set[str] = set()
        self.batches: list[Batch] = []
        self.now_us: list[int] = []
        self.gaps_ignored_before_us: list[int] = []
        self.outcomes: list[Outcome] | None = None
        self.events: list[AnomalyEvent] = []

    def step(self, batch: Batch, now_us: int, clock_offset_us: int = 0) -> StepResult:
        self.clock_offset_us = clock_offset_us
        self.now_us.append(now_us)
        self.batches.append(batch)
        outcomes = [Outcome.SCORED] * len(batch) if self.outcomes is None else self.outcomes
        result = StepResult(outcomes=np.array(outcomes, np.uint8), events=self.events, nis=np.full(len(batch), 1.0))
        self.outcomes, self.events = None, []
        return result

    def ignore_gaps_before(self, until_us: int) -> None:
        self.gaps_ignored_before_us.append(until_us)

    def absent_until(self, until_us: int) -> None:
        self.absent_until_us = until_us

    def states(self, stride: int = 1, phase: int = 0) -> PairStates:
        rows = np.arange(phase, self.vehicles, stride)
        n = rows.size
        columns = {
            name: np.full(n, 1.0)
            for name in ("lat_deg", "lon_deg", "heading_deg", "x_m", "offset_m", "v_mps", "statistic", "gate", "nis")
        }
        return PairStates(
            followers=[f"car{row}" for row in rows],
            leaders=[None] * n,
            t_us=np.full(n, 5),
            gap_m=np.full(n, np.nan),
            warming=rows == 0,
            anomalous=rows == 1,
            silent=rows == 2,
            **columns,
        )

    def qualities(self, stride: int = 1, phase: int = 0) -> QualityStates:
        rows = np.arange(phase, self.vehicles, stride)
        numbers = {field.name: np.full(rows.size, 0.01) for field in fields(SensorQualities)}
        return QualityStates(
            vehicles=[f"car{row}" for row in rows],
            t_us=np.full(rows.size, 5),
            levels=rows % 3,
            qualities=SensorQualities(**numbers),
        )


def event(**changes) -> AnomalyEvent:
    fields = {
        "event_id": "car1-5",
        "phase": Phase.ONSET,
        "kind": Kind.BIAS,
        "sensor": Sensor.LOCATION,
        "confidence": 0.9,
        "suspect": "car1",
        "leader": None,
        "follower": "car1",
        "t_us": 1_000,
        "onset_us": 1_000,
        "received_us": 3_000,
        "detected_us": 4_000,
        "nis": 40.0,
        "gate": 20.0,
        "statistic": 40.0,
        "p_value": 1e-9,
        "nu": (8.0, 0.1),
        "recovered": (100.0, 20.0, 0.1, np.nan),
        "evidence": Evidence(
            checkpoint=np.zeros((), READING), readings=np.zeros(3, READING), leaders=np.zeros(3, np.int64)
        ),
    }
    return AnomalyEvent(**(fields | changes))
