"""Records through the site: their rounds through the kernels, and their verdicts into the logs of events."""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from headway.core.consistency.pair_tests import pair_verdicts
from headway.core.pipeline.admission import admit
from headway.core.pipeline.classify import FILTER_EVENT, PAIR_EVENT, REAPPEARED
from headway.core.pipeline.finalise import Finalised, finalise
from headway.core.pipeline.ingest import Ingested, ingest
from headway.core.pipeline.ordering import rounds
from headway.core.runtime import rows as banks
from headway.core.runtime.bound_kernel import bind_signature
from headway.core.site.slot_end import SlotEnd
from headway.core.site.state import SiteState
from headway.core.tracking.tracks import evict as evict_tracks
from headway.core.types.batch import I64, Columns, Ids
from headway.core.types.identifiers import id_column, id_words
from headway.core.types.outcome import Outcome
from headway.core.types.records import Kind
from headway.core.types.step_result import AnomalyEvent, RecordVerdicts, RoundFailure, StepTally

_SCORED = np.uint8(Outcome.SCORED)
"""As numpy's own number it is compared ten times faster."""
_FAILURE_RECORDS = 20
"""Most records of a failed round whose input is kept."""


class Slot(NamedTuple):
    """The records (B,) of a batch that were received in one slot, and where to write what came of them."""

    ids: Ids
    leader_ids: Ids
    columns: Columns
    outcomes: NDArray[np.uint8]
    records: RecordVerdicts | None
    owned: NDArray[np.bool_] | None
    """(B,) whether this engine publishes and counts the vehicle; None: all of them."""

    def part(self, start: int, stop: int) -> "Slot":
        """Return the records from `start` to `stop`."""
        part = slice(start, stop)
        records = self.records
        return Slot(
            self.ids[part],
            self.leader_ids[part],
            Columns._make(column[part] for column in self.columns),
            self.outcomes[part],
            records and RecordVerdicts(records.verdicts[part], records.readings[part], records.leader_ids[part]),
            None if self.owned is None else self.owned[part],
        )


class RoundProcessor:
    """Processes the records of a slot on the tables of one site."""

    def __init__(self, site: SiteState, slot_end: SlotEnd) -> None:
        self._site = site
        self._slot_end = slot_end
        self._filters = site.tables.bank["model"]
        self._leader_rows = site.tables.pairing["leader_row"]
        self._workspace = np.zeros((site.config.vehicle_capacity, 2), np.int64)
        self._admit, self._rounds = bind_signature(admit), bind_signature(rounds)
        self._ingest, self._finalise = bind_signature(ingest), bind_signature(finalise)
        self._step_batch = bind_signature(site.model.step_batch)

    def process(self, slot: Slot, clock_offset_us: int, tally: StepTally) -> None:
        """Process the records of a slot, at least one, in the order of their arrival."""
        site, outcomes = self._site, slot.outcomes
        rows, declared_rows = self._assign_rows(slot, clock_offset_us)
        if slot.owned is not None:
            site.tables.owned[rows[rows >= 0]] = slot.owned[rows >= 0]
        site.reception.record(slot.columns.received_us)
        order, nth, count = self._rounds(rows, self._leader_rows, site.pair_events.suspects, outcomes, self._workspace)
        events: list[AnomalyEvent] = []
        for n in range(count):
            places = order if count == 1 else order[nth == n]
            try:
                self._process_round(slot, rows, declared_rows, places, events, tally)
            except Exception as error:  # noqa: BLE001 - a defect must not end the service; it is counted and logged
                self._fail(error, slot, rows, places, tally)
        events = site.published(events)
        tally.events += events if len(events) < 2 else _in_record_order(events, slot)

    def _assign_rows(self, slot: Slot, clock_offset_us: int) -> tuple[I64, I64]:
        """Return (B,) the rows of vehicles, a new one for each new vehicle, and of the leaders that they declare.

        The outcome is TABLE_FULL where no row is free, and another rejection where a record is too old or too new.
        """
        site, ids, outcomes, (t_us, received_us, *_) = self._site, slot.ids, slot.outcomes, slot.columns
        rows, declared_rows = np.empty((2, outcomes.size), np.int64)
        # Unix time is local time and the offset, so the age is that by local time and the offset.
        max_age_us = site.config.max_age_s * 1e6 - clock_offset_us
        max_ahead_us = site.config.max_ahead_s * 1e6 + clock_offset_us
        words, leader_words = id_words(ids), id_words(slot.leader_ids)
        index = site.vehicles.id_index
        if self._admit(
            index, words, leader_words, t_us, received_us, max_age_us, max_ahead_us, outcomes, rows, declared_rows
        ):
            return rows, declared_rows
        unknown = np.flatnonzero((rows < 0) & (outcomes == _SCORED))
        if unknown.size:
            first = dict(zip(ids[unknown[::-1]].tolist(), received_us[unknown[::-1]].tolist(), strict=True))
            admitted = site.vehicles.admit([vehicle.decode() for vehicle in reversed(first)])
            site.first_received_us[admitted] = list(reversed(first.values()))[: len(admitted)]
            rows, declared_rows = site.vehicles.rows(ids), site.vehicles.rows(slot.leader_ids)
            outcomes[(rows < 0) & (outcomes == _SCORED)] = Outcome.TABLE_FULL
        return rows, declared_rows

    def _fail(self, error: Exception, slot: Slot, all_rows: I64, places: I64, tally: StepTally) -> None:
        """Give the records of a round that failed their outcome, and forget the state that it touched."""
        rows, tables = all_rows[places], self._site.tables
        slot.outcomes[places] = Outcome.DETECTOR_FAILED
        banks.wipe(tables.bank, rows)
        banks.wipe(tables.newest_verdicts, rows)
        banks.wipe(tables.estimates, rows)
        banks.wipe(tables.earlier_estimates, rows)
        evict_tracks(tables.tracks, rows)
        ids, columns_of = self._site.vehicles.id_of, slot.columns._asdict().items()
        records: list[dict[str, object]] = [
            {"id": ids[all_rows[i]], **{name: column[i].item() for name, column in columns_of}}
            for i in places[:_FAILURE_RECORDS].tolist()
        ]
        tally.failures.append(RoundFailure(f"{type(error).__name__}: {error}", records))

    def _process_round(
        self, slot: Slot, rows: I64, declared_rows: I64, places: I64, events: list[AnomalyEvent], tally: StepTally
    ) -> None:
        """Process the records at `places` of the slot, which are of distinct vehicles; add to `events`."""
        tables, params, model = self._site.tables, self._site.params, self._site.model
        absent_until_us = self._site.reception.absent_until_us
        ingested = self._ingest(
            tables, slot.columns, rows, declared_rows, places, absent_until_us, params, slot.outcomes
        )
        self._step_batch(self._filters, ingested.rows, ingested.readings, model.params, ingested.verdicts)
        finalised = self._finalise(tables, ingested, slot.columns.received_us, params, slot.outcomes)
        due = finalised.search_due
        if due.size:
            self._slot_end.add(ingested.rows[due], declared_rows[ingested.places[due]])
        tally.sequence_gaps += ingested.sequence_gaps
        tally.nis.append(finalised.nis)
        tally.anomalous += finalised.classified.anomalous
        tally.repairs += finalised.classified.repairs
        tally.restarts += finalised.classified.restarts
        tally.resets += finalised.resets
        if finalised.classified.all_marks:
            events += self._update_events(slot.columns, ingested, finalised, tally)
        if slot.records is not None:
            self._write_records(ingested, finalised, slot.records)

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

    def _update_events(
        self, batch: Columns, ingested: Ingested, finalised: Finalised, tally: StepTally
    ) -> list[AnomalyEvent]:
        """Update the logs with the marked readings: all at once, or one by one where the order has an effect."""
        marks, events = finalised.classified.marks, list[AnomalyEvent]()
        marked, rows = np.flatnonzero(marks), ingested.rows
        by_filter, by_pair = rows[marks & FILTER_EVENT > 0], marks & PAIR_EVENT > 0
        suspects = ingested.leaders[by_pair], self._site.pair_events.suspects[rows[by_pair]]
        ordered = by_filter.size > 0 and bool(np.isin(np.concatenate(suspects), by_filter).any())
        for some in marked[:, None] if ordered else (marked,):
            events += self._update_logs(some, batch, ingested, finalised, tally)
        return events

    def _update_logs(
        self, some: I64, batch: Columns, ingested: Ingested, finalised: Finalised, tally: StepTally
    ) -> list[AnomalyEvent]:
        """Update each log with those of the readings at the places `some` that are marked for it."""
        events: list[AnomalyEvent] = []
        rows, leaders, verdicts = ingested.rows, ingested.leaders, ingested.verdicts
        marks = finalised.classified.marks[some]
        t_us, received_us = batch.t_us[ingested.places], batch.received_us[ingested.places]
        at = some[marks & FILTER_EVENT > 0]
        if at.size:
            row = rows[at]
            self._site.events.take_over(self._site.pair_events, row[verdicts["anomalous"][at]])
            events += self._site.events.update(row, row, leaders[at], t_us[at], received_us[at], verdicts[at])
        at = some[marks & PAIR_EVENT > 0]
        if at.size:
            # One cause, one event: a vehicle whose own readings are at fault explains what the pair tests find.
            explained = self._site.events.explains(rows[at], t_us[at]) | self._site.events.explains(
                leaders[at], t_us[at]
            )
            finalised.pair_verdicts["kind"][at[explained]] = Kind.NONE
            found, odds = finalised.pair_verdicts[at], finalised.pair_verdicts["follower_log_odds"][at]
            pair = pair_verdicts(found, verdicts[at])
            suspects = np.where((odds < 0.0) & (leaders[at] >= 0), leaders[at], rows[at])
            tally.anomalous += int((pair["anomalous"] & self._site.tables.owned[rows[at]]).sum())
            events += self._site.pair_events.update(rows[at], suspects, leaders[at], t_us[at], received_us[at], pair)
        at = some[marks & REAPPEARED > 0]
        if at.size:
            last_received_us = ingested.last_received_us[at]
            events += self._update_misses(rows[at], leaders[at], last_received_us, t_us[at], received_us[at])
        return events

    def _update_misses(
        self, rows: I64, leaders: I64, last_received_us: I64, t_us: I64, received_us: I64
    ) -> Iterator[AnomalyEvent]:
        """End the misses of vehicles that reappeared; start and end a miss that no neighbour could show before."""
        site = self._site
        for i in range(rows.size):
            row, leader, last_us, now_us = int(rows[i]), int(leaders[i]), int(last_received_us[i]), int(received_us[i])
            if not site.misses.active[row]:
                if not site.reception.was_receiving(last_us, now_us):
                    continue
                yield site.misses.start(row, leader, int(t_us[i]), last_us, now_us)
            yield site.misses.end(row, leader, int(t_us[i]), now_us, now_us)


def _in_record_order(events: list[AnomalyEvent], slot: Slot) -> list[AnomalyEvent]:
    """Return the events in the order of the records that caused them, whatever the rounds were."""
    accepted = np.flatnonzero(slot.outcomes <= Outcome.WARMING)
    keys = zip(slot.ids[accepted].tolist(), slot.columns.t_us[accepted].tolist(), strict=True)
    places = {key: place for place, key in enumerate(keys)}
    return sorted(events, key=lambda event: places[event.follower.encode(), event.t_us])
