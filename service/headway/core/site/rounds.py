"""A batch through the site: its rounds through the kernels, and their verdicts into the logs of events."""

import numpy as np
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import pair_verdicts
from headway.core.pipeline.classify import FILTER_EVENT, PAIR_EVENT, REAPPEARED
from headway.core.pipeline.finalise import Finalised, finalise
from headway.core.pipeline.ingest import Ingested, ingest
from headway.core.pipeline.ordering import reject_by_age, rounds
from headway.core.runtime import rows as banks
from headway.core.runtime.bound_kernel import bind_signature
from headway.core.site.state import SiteState
from headway.core.tracking.tracks import evict as evict_tracks
from headway.core.types.batch import I64, Batch, Columns, columns
from headway.core.types.identifiers import id_column
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind
from headway.core.types.step_result import RecordVerdicts, RoundFailure, StepTally

_SCORED = np.uint8(Outcome.SCORED)
"""As numpy's own number it is compared ten times faster."""
_FAILURE_RECORDS = 20
"""Most records of a failed round whose input is kept."""


class RoundProcessor:
    """Processes batches on the tables of one site."""

    def __init__(self, site: SiteState) -> None:
        self._site = site
        self._filters = site.tables.bank["model"]
        self._records_by_row = np.zeros(site.config.vehicle_capacity, np.int64)
        self._ingest, self._finalise = bind_signature(ingest), bind_signature(finalise)
        self._step_batch = bind_signature(site.model.step_batch)

    def process(self, batch: Batch, now_us: int, clock_offset_us: int, tally: StepTally) -> NDArray[np.uint8]:
        """Return (B,) the outcome of each record of a batch, B > 0; `now_us` is the local time."""
        site, outcomes = self._site, np.empty(len(batch), np.uint8)
        max_age_us, max_ahead_us = site.config.max_age_s * 1e6, site.config.max_ahead_s * 1e6
        reject_by_age(batch.t_us - clock_offset_us, batch.received_us, max_age_us, max_ahead_us, outcomes)
        rows = self._assign_rows(batch, outcomes)
        declared_rows = site.vehicles.rows(batch.leader_ids)
        site.reception.record(batch.received_us)
        numbers = columns(batch)
        order, nth, count = rounds(rows, batch.t_us, outcomes, self._records_by_row)
        for n in range(count):
            places = order if count == 1 else order[nth == n]
            try:
                self._process_round(numbers, rows, declared_rows, places, now_us, outcomes, tally)
            except Exception as error:  # noqa: BLE001 - a defect must not end the service; it is counted and logged
                self._fail(error, numbers, rows, places, outcomes, tally)
        return outcomes

    def _assign_rows(self, batch: Batch, outcomes: NDArray[np.uint8]) -> I64:
        """Return (B,) rows, a new one for each new vehicle; the outcome is TABLE_FULL where no row is free."""
        site = self._site
        rows = site.vehicles.rows(batch.ids)
        if rows.min() >= 0:
            return rows
        unknown = np.flatnonzero((rows < 0) & (outcomes == _SCORED))
        if unknown.size:
            admitted = site.vehicles.admit({name.decode() for name in batch.ids[unknown].tolist()})
            site.first_received_us[admitted] = batch.received_us[unknown].min()
            rows = site.vehicles.rows(batch.ids)
            outcomes[(rows < 0) & (outcomes == _SCORED)] = Outcome.TABLE_FULL
        return rows

    def _fail(
        self,
        error: Exception,
        batch: Columns,
        all_rows: I64,
        places: I64,
        outcomes: NDArray[np.uint8],
        tally: StepTally,
    ) -> None:
        """Give the records of a round that failed their outcome, and forget the state that it touched."""
        rows = all_rows[places]
        outcomes[places] = Outcome.DETECTOR_FAILED
        banks.wipe(self._site.tables.bank, rows)
        banks.wipe(self._site.tables.newest_verdicts, rows)
        evict_tracks(self._site.tables.tracks, rows)
        ids, columns_of = self._site.vehicles.id_of, batch._asdict().items()
        records: list[dict[str, object]] = [
            {"id": ids[all_rows[i]], **{name: column[i].item() for name, column in columns_of}}
            for i in places[:_FAILURE_RECORDS].tolist()
        ]
        tally.failures.append(RoundFailure(f"{type(error).__name__}: {error}", records))

    def _process_round(
        self,
        batch: Columns,
        all_rows: I64,
        declared_rows: I64,
        places: I64,
        now_us: int,
        outcomes: NDArray[np.uint8],
        tally: StepTally,
    ) -> None:
        """Process the records at `places` of the batch, which are of distinct vehicles."""
        tables, params, model = self._site.tables, self._site.params, self._site.model
        ingested = self._ingest(tables, batch, all_rows, declared_rows, places, params, outcomes)
        self._step_batch(self._filters, ingested.rows, ingested.readings, model.params, ingested.verdicts)
        finalised = self._finalise(tables, ingested, declared_rows, now_us, params, outcomes)
        tally.sequence_gaps += ingested.sequence_gaps
        tally.leader_changes += finalised.leader_changes
        tally.nis.append(finalised.nis)
        tally.anomalous += finalised.classified.anomalous
        tally.repairs += finalised.classified.repairs
        tally.restarts += finalised.classified.restarts
        tally.resets += finalised.resets
        if finalised.classified.all_marks:
            self._update_events(batch, ingested, finalised, tally)
        if tally.records is not None:
            self._write_records(ingested, finalised, tally.records)

    def _write_records(self, ingested: Ingested, finalised: Finalised, out: RecordVerdicts) -> None:
        """Write what was found of each record."""
        verdicts = ingested.verdicts
        pair, ids = finalised.pair_verdicts, self._site.vehicles.id_of
        by_pair = (pair["kind"] != Kind.NONE) & (pair["follower_log_odds"] >= 0.0) & ~verdicts["anomalous"]
        if by_pair.any():
            verdicts = np.where(by_pair, pair_verdicts(pair, verdicts), verdicts)
        out.verdicts[ingested.places] = verdicts
        out.readings[ingested.places] = ingested.readings
        leader_ids = [ids[row] if row >= 0 else None for row in ingested.leaders.tolist()]
        out.leader_ids[ingested.places] = id_column(leader_ids)

    def _update_events(self, batch: Columns, ingested: Ingested, finalised: Finalised, tally: StepTally) -> None:
        """Update each log with the readings marked for it."""
        rows, leaders, verdicts = ingested.rows, ingested.leaders, ingested.verdicts
        marks = finalised.classified.marks
        t_us, received_us = batch.t_us[ingested.places], batch.received_us[ingested.places]
        at = np.flatnonzero(marks & FILTER_EVENT)
        if at.size:
            row = rows[at]
            self._site.events.take_over(self._site.pair_events, row[verdicts["anomalous"][at]])
            tally.events += self._site.events.update(row, row, leaders[at], t_us[at], received_us[at], verdicts[at])
        at = np.flatnonzero(marks & PAIR_EVENT)
        if at.size:
            # One cause, one event: a vehicle whose own readings are at fault explains what the pair tests find.
            explained = self._site.events.explains(rows[at], t_us[at]) | self._site.events.explains(
                leaders[at], t_us[at]
            )
            finalised.pair_verdicts["kind"][at[explained]] = Kind.NONE
            found, odds = finalised.pair_verdicts[at], finalised.pair_verdicts["follower_log_odds"][at]
            pair = pair_verdicts(found, verdicts[at])
            suspects = np.where((odds < 0.0) & (leaders[at] >= 0), leaders[at], rows[at])
            tally.anomalous += int(pair["anomalous"].sum())
            tally.events += self._site.pair_events.update(
                rows[at], suspects, leaders[at], t_us[at], received_us[at], pair
            )
        at = np.flatnonzero(marks & REAPPEARED)
        if at.size:
            self._update_misses(rows[at], leaders[at], ingested.last_received_us[at], t_us[at], received_us[at], tally)

    def _update_misses(
        self, rows: I64, leaders: I64, last_received_us: I64, t_us: I64, received_us: I64, tally: StepTally
    ) -> None:
        """End the misses of vehicles that reappeared; start and end a miss that no neighbour could show before."""
        site = self._site
        for i in range(rows.size):
            row, leader, last_us = int(rows[i]), int(leaders[i]), int(last_received_us[i])
            if not site.misses.active[row]:
                if not site.reception.was_receiving(last_us, int(received_us[i])):
                    continue
                tally.events.append(site.misses.start(row, leader, int(t_us[i]), last_us))
            tally.events.append(site.misses.end(row, leader, int(t_us[i]), int(received_us[i])))
