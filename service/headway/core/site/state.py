"""The state of one site: a row for each vehicle, the same number in every table, and the logs of open events."""

from collections.abc import Iterable

import numpy as np

from headway.core.events.event_log import EventLog
from headway.core.events.evidence import EvidenceStore
from headway.core.events.miss_log import MissLog
from headway.core.pipeline.detectors import build_detectors
from headway.core.pipeline.estimates import new_estimates
from headway.core.pipeline.tables import RoundParams, Tables
from headway.core.runtime import rows as banks
from headway.core.tracking import tracks
from headway.core.tracking.coverage import new_coverage
from headway.core.tracking.pairing import NO_LEADER, leaders_of, new_pairing
from headway.core.tracking.reception import ReceptionMonitor
from headway.core.tracking.spatial_index import new_grid
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import I64
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.step_result import AnomalyEvent

BLOCK_ROWS = 16


class SiteState:
    """The tables and logs of one site, allocated once for `vehicle_capacity` rows."""

    def __init__(self, config: DetectorConfig) -> None:
        capacity = config.vehicle_capacity
        detectors = build_detectors(config)
        bank = np.zeros(capacity, detectors.dtype)
        self.config = config
        self.model = detectors.model
        self.vehicles = VehicleTable(capacity)
        self.reception = ReceptionMonitor()
        self.first_received_us: I64 = np.zeros(capacity, np.int64)
        """(C,) receive time of each vehicle's first message."""
        self.declared_rows: I64 = np.full(capacity, NO_LEADER)
        """(C,) row of the leader that each vehicle's last message declares."""
        self.evidence = EvidenceStore(bank, config.evidence_readings)
        self.events = EventLog(self.vehicles, self.evidence, capacity)
        self.pair_events = EventLog(self.vehicles, self.evidence, capacity, suffix="-link")
        self.misses = MissLog(self.vehicles, capacity)
        self.tables = Tables(
            tracks=tracks.new_tracks(capacity),
            pairing=new_pairing(capacity),
            grid=new_grid(capacity),
            coverage=new_coverage(),
            bank=bank,
            bank_bytes=bank.view(np.uint8).reshape(capacity, -1),
            pair_tests=bank["pair_tests"],
            plausibility=bank["plausibility"],
            newest_verdicts=banks.verdicts(capacity),
            estimates=new_estimates(capacity),
            earlier_estimates=new_estimates(capacity),
            evidence=self.evidence.tables,
            filter_event_active=self.events.active,
            pair_event_active=self.pair_events.active,
            miss_event_active=self.misses.active,
            owned=np.ones(capacity, np.bool_),
        )
        self.params = RoundParams(
            max_gap_s=config.max_gap_s,
            pairing_range_m=config.pairing_range_m,
            lane_width_m=config.lane_width_m,
            silence_timeout_s=config.silence_timeout_s,
            warming_readings=config.warming_readings,
            pair_tests=detectors.pair_test_params,
            limits=detectors.limits,
            model_bytes=detectors.model.dtype.itemsize,
        )

    def rows(self, stride: int = 1, phase: int = 0) -> I64:
        """Return the rows in use of every `stride`-th block of rows, from block `phase`: a few vehicles share one."""
        rows: I64 = np.flatnonzero(self.vehicles.in_use)
        return rows if stride == 1 else rows[rows // BLOCK_ROWS % stride == phase]

    def owned_rows(self, stride: int = 1, phase: int = 0) -> I64:
        """Return those of the rows whose vehicles this engine publishes."""
        rows = self.rows(stride, phase)
        return rows[self.tables.owned[rows]]

    def published(self, events: Iterable[AnomalyEvent]) -> list[AnomalyEvent]:
        """Return the events of vehicles that this engine publishes."""
        of = list(events)
        rows = self.vehicles.rows(id_column([event.follower for event in of])) if of else ()
        return [event for event, row in zip(of, rows, strict=True) if self.tables.owned[row]]

    def leaders(self, rows: I64) -> I64:
        """Return (n,) the row of each one's leader, NO_LEADER for none."""
        leaders = np.empty(rows.size, np.int64)
        leaders_of(self.tables.tracks, self.tables.pairing, rows, leaders)
        return leaders

    def evict(self, rows: I64) -> None:
        """Free these rows in every table; open events end without an update."""
        for row in rows.tolist():
            self.events.evict(row)
            self.pair_events.evict(row)
            self.misses.drop(row)
            self.vehicles.evict(row)
        tracks.evict(self.tables.tracks, rows)
        banks.wipe(self.tables.bank, rows)
        for table in (self.tables.newest_verdicts, self.tables.estimates, self.tables.earlier_estimates):
            banks.wipe(table, rows)
        self.evidence.clear(rows)
        self.tables.owned[rows] = True
