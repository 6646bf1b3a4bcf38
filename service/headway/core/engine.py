"""The only door of the core: a batch of records in, one outcome for each and the events they cause out."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import pair_verdicts
from headway.core.events.event_log import EventLog
from headway.core.events.evidence import EvidenceStore
from headway.core.events.miss_log import MissLog
from headway.core.pipeline import classify
from headway.core.pipeline.detectors import build_detectors
from headway.core.pipeline.finalise import Finalised, finalise
from headway.core.pipeline.ingest import Ingested, ingest
from headway.core.pipeline.ordering import reject_by_age, rounds
from headway.core.pipeline.tables import Columns, Limits, Tables, columns
from headway.core.runtime import rows as banks
from headway.core.runtime.bound_kernel import bind_signature
from headway.core.tracking import pairing, reception, spatial_index, tracks
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.batch import I64, Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records
from headway.core.types.snapshot import Snapshot
from headway.core.types.step_result import AnomalyEvent, PairStates, StepResult

_SCORED = np.uint8(Outcome.SCORED)
"""As numpy's own number it is compared ten times faster."""

HOUSEKEEPING_US = 100_000
"""How often silence and forgetting are looked at."""


@dataclass(slots=True)
class _Tally:
    """What a step adds up for its `StepResult`."""

    events: list[AnomalyEvent]
    nis: list[NDArray[np.float64]]
    anomalous: int = 0
    sequence_gaps: int = 0
    repairs: int = 0
    restarts: int = 0
    evicted: int = 0
    leader_changes: int = 0


class Engine:
    """All state of one site: a row for each vehicle in tracks, pairing, bank and evidence alike."""

    def __init__(self, config: DetectorConfig) -> None:
        capacity = config.vehicle_capacity
        self._config = config
        detectors = build_detectors(config)
        self._model, self._pair_test_params = detectors.model, detectors.pair_test_params
        self._vehicles = VehicleTable(capacity)
        self._tracks = tracks.new_tracks(capacity)
        self._pairing = pairing.new_pairing(capacity)
        self._grid = spatial_index.new_grid(capacity)
        self._bank = np.zeros(capacity, detectors.dtype)
        self._verdicts = banks.verdicts(capacity)
        self._verdict_t_s = np.zeros(capacity)
        self._evidence = EvidenceStore(self._bank, config.evidence_readings)
        self._events = EventLog(self._vehicles, self._evidence, capacity)
        self._pair_events = EventLog(self._vehicles, self._evidence, capacity, suffix="-link")
        self._misses = MissLog(self._vehicles, capacity)
        self._records_by_row = np.zeros(capacity, np.int64)
        self._reception = reception.ReceptionMonitor()
        self._first_received_us = np.zeros(capacity, np.int64)
        self._pseudonym_changed_us = np.zeros(capacity, np.int64)
        self._outage_until_us = 0
        self._housekeeping_us = 0
        self.pairs = 0
        """Vehicles that follow somebody, as of the last housekeeping: any thread may read it, unlike the tables."""
        self._filters = self._bank["model"]
        self._ingest, self._finalise = bind_signature(ingest), bind_signature(finalise)
        self._step_batch = bind_signature(self._model.step_batch)
        self._round_tables = Tables(
            tracks=self._tracks,
            pairing=self._pairing,
            grid=self._grid,
            bank=self._bank,
            bank_bytes=self._bank.view(np.uint8).reshape(capacity, -1),
            pair_tests=self._bank["pair_tests"],
            newest_verdicts=self._verdicts,
            verdict_t_s=self._verdict_t_s,
            rings=self._evidence.rings,
            filter_event_active=self._events.active,
            pair_event_active=self._pair_events.active,
            miss_event_active=self._misses.active,
        )
        self._limits = Limits(
            config.max_gap_s,
            config.pairing_range_m,
            config.lane_width_m,
            config.silence_timeout_s,
            config.warming_readings,
        )

    @property
    def vehicles(self) -> int:
        """Vehicles known now."""
        return len(self._vehicles)

    @property
    def active_events(self) -> int:
        """Events under way."""
        return len(self._events) + len(self._pair_events) + len(self._misses)

    def step(self, batch: Batch, now_us: int) -> StepResult:
        """Judge a batch at local time `now_us` (Unix microseconds); an empty batch lets time pass.

        The order of the records within a batch is of no account: they are taken by event time.
        """
        outcomes = np.empty(len(batch), np.uint8)
        tally = _Tally([], [])
        if len(batch):
            max_age_us, max_ahead_us = self._config.max_age_s * 1e6, self._config.max_ahead_s * 1e6
            reject_by_age(batch.t_us, batch.received_us, max_age_us, max_ahead_us, outcomes)
            rows = self._rows(batch, outcomes)
            declared = self._vehicles.rows(batch.leader_ids)
            self._reception.record(batch.received_us)
            numbers = columns(batch)
            order, nth, count = rounds(rows, batch.t_us, outcomes, self._records_by_row)
            for n in range(count):
                round_places = order if count == 1 else order[nth == n]
                self._process_round(numbers, rows, declared, round_places, now_us, outcomes, tally)
        if now_us - self._housekeeping_us >= HOUSEKEEPING_US:
            self._housekeeping_us = now_us
            self._housekeeping(now_us, tally)
        return StepResult(
            outcomes=outcomes,
            events=tally.events,
            nis=np.concatenate([np.empty(0), *tally.nis]),
            anomalous=tally.anomalous,
            sequence_gaps=tally.sequence_gaps,
            repairs=tally.repairs,
            restarts=tally.restarts,
            evicted=tally.evicted,
            leader_changes=tally.leader_changes,
        )

    def ignore_gaps_before(self, until_us: int) -> None:
        """Hold no silence before local time `until_us` against anybody: messages were lost here."""
        self._outage_until_us = until_us

    def _rows(self, batch: Batch, outcomes: NDArray[np.uint8]) -> I64:
        """Return (B,) rows, giving one to each new vehicle; who finds no room is `TABLE_FULL`."""
        rows = self._vehicles.rows(batch.ids)
        if rows.min() >= 0:
            return rows
        unknown = np.flatnonzero((rows < 0) & (outcomes == _SCORED))
        if unknown.size:
            admitted = self._vehicles.admit({name.decode() for name in batch.ids[unknown].tolist()})
            self._first_received_us[admitted] = batch.received_us[unknown].min()
            rows = self._vehicles.rows(batch.ids)
            outcomes[(rows < 0) & (outcomes == _SCORED)] = Outcome.TABLE_FULL
        return rows

    def _process_round(
        self,
        batch: Columns,
        all_rows: I64,
        declared: I64,
        round_places: I64,
        now_us: int,
        outcomes: NDArray[np.uint8],
        tally: _Tally,
    ) -> None:
        """Take records of distinct vehicles through tracks, filter, pairing and events.

        `round_places` are their places in the batch, and in `all_rows`, `declared` and `outcomes` of the whole batch.
        """
        limits = self._limits
        ingested = self._ingest(self._round_tables, batch, all_rows, declared, round_places, limits.max_gap_s, outcomes)
        verdicts = banks.verdicts(ingested.rows.size)
        self._step_batch(self._filters, ingested.rows, ingested.readings, self._model.params, verdicts)
        finalised = self._finalise(
            self._round_tables, ingested, declared, verdicts, now_us, limits, self._pair_test_params, outcomes
        )
        tally.sequence_gaps += ingested.sequence_gaps
        tally.leader_changes += finalised.leader_changes
        tally.nis.append(finalised.nis)
        tally.anomalous += finalised.counts.anomalous
        tally.repairs += finalised.counts.repairs
        tally.restarts += finalised.counts.restarts
        if finalised.counts.marks:
            self._update_events(batch, ingested, verdicts, finalised, tally)

    def _update_events(
        self, batch: Columns, ingested: Ingested, verdicts: Records, finalised: Finalised, tally: _Tally
    ) -> None:
        """Show the logs of events what they have to look at."""
        rows, leaders = ingested.rows, ingested.leaders
        t_us, received_us = batch.t_us[ingested.places], batch.received_us[ingested.places]
        if finalised.counts.marks & classify.FILTER_EVENT:
            at = np.flatnonzero(finalised.marks & classify.FILTER_EVENT)
            row = rows[at]
            tally.events += self._events.judge(row, row, leaders[at], t_us[at], received_us[at], verdicts[at])
        if finalised.counts.marks & classify.PAIR_EVENT:
            at = np.flatnonzero(finalised.marks & classify.PAIR_EVENT)
            self._update_pair_events(
                rows[at], leaders[at], t_us[at], received_us[at], verdicts[at], finalised.pair_tests[at], tally
            )
        if finalised.counts.marks & classify.REAPPEARED:
            at = np.flatnonzero(finalised.marks & classify.REAPPEARED)
            self._update_misses(rows[at], leaders[at], ingested.last_received_us[at], t_us[at], received_us[at], tally)

    def _update_pair_events(
        self,
        rows: I64,
        leaders: I64,
        t_us: I64,
        received_us: I64,
        verdicts: Records,
        pair_tests: Records,
        tally: _Tally,
    ) -> None:
        """Tell of pairs that the link tests speak of, or did until now; events name the suspect."""
        pair_verdict, odds = pair_verdicts(pair_tests, verdicts), pair_tests["follower_log_odds"]
        suspects = np.where((odds < 0.0) & (leaders >= 0), leaders, rows)
        tally.anomalous += int(pair_verdict["anomalous"].sum())
        tally.events += self._pair_events.judge(rows, suspects, leaders, t_us, received_us, pair_verdict)

    def _update_misses(
        self, rows: I64, leaders: I64, last_received_us: I64, t_us: I64, received_us: I64, tally: _Tally
    ) -> None:
        """End the misses of vehicles that are back, and state those that no neighbour could bear witness to."""
        for i in range(rows.size):
            row, leader = int(rows[i]), int(leaders[i])
            if not self._misses.active[row]:
                in_outage = last_received_us[i] < self._outage_until_us
                if in_outage or not self._reception.was_receiving(int(last_received_us[i]), int(received_us[i])):
                    continue
                tally.events.append(self._misses.begin(row, leader, int(t_us[i]), int(last_received_us[i])))
            tally.events.append(self._misses.end(row, leader, int(t_us[i]), int(received_us[i])))

    def _housekeeping(self, now_us: int, tally: _Tally) -> None:
        """Look at who is silent, and forget who has been for long."""
        rows = np.flatnonzero(self._vehicles.in_use)
        last_received_us = self._tracks["received_us"]
        leaders = self._leaders(rows)
        self._count_pairs(leaders)
        ignored = (
            self._misses.active
            | (self._pseudonym_changed_us == last_received_us)
            | (last_received_us < self._outage_until_us)
        )
        limits = self._config.silence_timeout_s, self._config.warming_readings
        overdue = reception.overdue(self._tracks, rows, leaders, ignored, now_us, *limits)
        for i in np.flatnonzero(overdue):
            row = int(rows[i])
            if reception.pseudonym_changed(self._tracks, self._first_received_us, row, rows):
                self._pseudonym_changed_us[row] = last_received_us[row]
            else:
                t_us = int(self._tracks["t_us"][row])
                tally.events.append(self._misses.begin(row, int(leaders[i]), t_us, int(last_received_us[row])))
        gone = rows[now_us - last_received_us[rows] > self._config.vehicle_ttl_s * 1e6]
        if gone.size:
            self._evict(gone, tally)
            self._count_pairs(self._leaders(np.flatnonzero(self._vehicles.in_use)))

    def _evict(self, rows: I64, tally: _Tally) -> None:
        """Free these rows everywhere."""
        for row in rows.tolist():
            if self._misses.active[row]:
                track = self._tracks[row]
                tally.events.append(self._misses.end(row, -1, int(track["t_us"]), int(track["received_us"])))
            self._events.drop(row)
            self._pair_events.drop(row)
            self._vehicles.evict(row)
        tracks.evict(self._tracks, rows)
        self._wipe(rows)
        banks.wipe(self._verdicts, rows)
        tally.evicted += rows.size

    def _wipe(self, rows: I64) -> None:
        """Let what is known of each vehicle as a row of the bank begin anew."""
        banks.wipe(self._bank, rows)
        self._evidence.clear(rows)

    def _count_pairs(self, leaders: I64) -> None:
        self.pairs = int((leaders >= 0).sum())

    def _leaders(self, rows: I64) -> I64:
        """Return (B,) the row of each one's leader, NO_LEADER for none."""
        leaders = np.empty(rows.size, np.int64)
        pairing.leaders_of(self._tracks, self._pairing, rows, leaders)
        return leaders

    def states(self, stride: int = 1, phase: int = 0) -> PairStates:
        """Return the vehicles whose row is `phase` modulo `stride`, as columns."""
        rows = np.flatnonzero(self._vehicles.in_use)
        rows = rows[rows % stride == phase]
        track, verdict = self._tracks[rows], self._verdicts[rows]
        leaders, gap_m = self._leaders(rows), np.empty(rows.size)
        pairing.gaps_m(self._tracks, self._pairing, rows, gap_m)
        ids = self._vehicles.id_of
        return PairStates(
            followers=[str(ids[row]) for row in rows],
            leaders=[ids[row] if row >= 0 else None for row in leaders],
            t_us=track["t_us"],
            lat_deg=track["lat_deg"],
            lon_deg=track["lon_deg"],
            heading_deg=np.degrees(np.arctan2(track["heading_east"], track["heading_north"])) % 360.0,
            gap_m=gap_m,
            x_m=verdict["x_m"],
            v_mps=verdict["v_mps"],
            statistic=verdict["statistic"],
            gate=verdict["gate"],
            nis=verdict["nis"],
            warming=verdict["warming"],
            anomalous=self._events.active[rows] | self._pair_events.active[rows],
            silent=self._misses.active[rows],
        )

    def snapshot(self, stride: int = 1, phase: int = 0) -> Snapshot:
        """Return copies of all that is known of the vehicles whose row is `phase` modulo `stride`.

        Parts taken one after the other, with steps between them, make a whole that `restore` accepts.
        """
        rows = np.flatnonzero(self._vehicles.in_use)
        rows = rows[rows % stride == phase]
        return Snapshot(
            rows=rows,
            ids=[str(self._vehicles.id_of[row]) for row in rows],
            tables={name: table[rows] for name, table in self._tables.items()},
            events=self._events.snapshot(rows),
            pair_events=self._pair_events.snapshot(rows),
            misses=self._misses.snapshot(rows),
        )

    def restore(self, snapshot: Snapshot, now_us: int) -> int:
        """Go on with the vehicles of a snapshot that were heard within `vehicle_ttl_s`; return how many.

        This engine must not know any vehicle yet, and the snapshot must be of its configuration and of this core.
        Nobody is accused of the silence in between: it was ours.
        """
        last_received_us = snapshot.tables["tracks"]["received_us"]
        newest = np.argsort(last_received_us, kind="stable")[::-1]
        _, first = np.unique(np.array(snapshot.ids, dtype=np.str_)[newest], return_index=True)
        kept = newest[first]
        kept = np.sort(kept[now_us - last_received_us[kept] <= self._config.vehicle_ttl_s * 1e6])
        rows = snapshot.rows[kept]
        self._vehicles.restore(rows, [snapshot.ids[i] for i in kept])
        for name, table in self._tables.items():
            table[rows] = snapshot.tables[name][kept]
        for column in ("leader_row", "candidate_row"):
            whom = self._pairing[column][rows]
            self._pairing[column][rows] = np.where(self._vehicles.in_use[whom], whom, pairing.NO_LEADER)
        self._events.restore([event for event in snapshot.events if self._vehicles.in_use[event.row]])
        self._pair_events.restore([event for event in snapshot.pair_events if self._vehicles.in_use[event.row]])
        self._misses.restore([miss for miss in snapshot.misses if self._vehicles.in_use[miss.row]])
        self._count_pairs(self._leaders(rows))
        self.ignore_gaps_before(now_us)
        return int(rows.size)

    @property
    def _tables(self) -> dict[str, NDArray[Any]]:
        """What is kept of each row, by name, as far as a snapshot holds it."""
        return {
            "tracks": self._tracks,
            "pairing": self._pairing,
            "bank": self._bank,
            "verdicts": self._verdicts,
            "verdict_t_s": self._verdict_t_s,
            "first_received_us": self._first_received_us,
        }

    def warm_up(self) -> None:
        """Compile or load every kernel, on a vehicle pair of an engine of its own: this one stays as it is."""
        other = Engine(replace(self._config, vehicle_capacity=2))
        for k in range(2):
            other.step(_example(k), now_us=1 + k * 100_000)
        other.states()
        reception.pseudonym_changed(other._tracks, other._first_received_us, 0, np.arange(2))
        other._vehicles.evict(0)


def _example(k: int) -> Batch:
    """Two vehicles 20 m apart going north, k tenths of a second on."""
    t_us = np.full(2, 1 + k * 100_000)
    nothing = np.full(2, np.nan)
    return Batch(
        ids=id_column(["leader", "follower"]),
        leader_ids=id_column([None, "leader"]),
        msg_cnt=np.full(2, k),
        t_us=t_us,
        received_us=t_us,
        lat_deg=np.array([2e-4, 0.0]) + k * 1e-5,
        lon_deg=np.zeros(2),
        speed_mps=np.full(2, 11.0),
        heading_deg=np.zeros(2),
        accel_mps2=nothing,
        accuracy_m=nothing,
        length_m=nothing,
        range_m=nothing,
        range_rate_mps=nothing,
    )
