"""The only door of the core: a batch of records in, one outcome for each and the events they cause out."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from headway.core import bank as banks
from headway.core import neighbours, pairing, silence, tracks
from headway.core.batch import I64, Batch
from headway.core.config import DetectorConfig
from headway.core.events import EventLog
from headway.core.evidence import EvidenceStore
from headway.core.gather import gather
from headway.core.geometry import metres_per_degree
from headway.core.judges import judges
from headway.core.link import LINK_VERDICT, link_said, standing, step_links
from headway.core.outcome import Outcome
from headway.core.records import Kind, Records, Sensor
from headway.core.snapshot import Snapshot
from headway.core.turn import AnomalyEvent, PairStates, Turn
from headway.core.vehicles import VehicleTable

HOUSEKEEPING_US = 100_000
"""How often silence and forgetting are looked at."""

RENAMED_WITHIN_M, RENAMED_SHARE = 5.0, 0.2
"""A new vehicle this near to where a silent one would be (plus a share of the way it may have gone) is that vehicle."""


@dataclass(slots=True)
class _Tally:
    """What a step adds up for its `Turn`."""

    events: list[AnomalyEvent]
    nis: list[NDArray[np.float64]]
    anomalous: int = 0
    missed_messages: int = 0
    repairs: int = 0
    restarts: int = 0
    forgotten: int = 0
    leader_changes: int = 0


class Engine:
    """All state of one site: a row for each vehicle in tracks, pairing, bank and evidence alike."""

    def __init__(self, config: DetectorConfig) -> None:
        capacity = config.vehicle_capacity
        self._config = config
        judging = judges(config)
        self._model, self._link_params = judging.model, judging.link_params
        self._vehicles = VehicleTable(capacity)
        self._tracks = tracks.new_tracks(capacity)
        self._pairing = pairing.new_pairing(capacity)
        self._grid = neighbours.new_grid(capacity)
        self._bank = np.zeros(capacity, judging.dtype)
        self._verdicts = banks.verdicts(capacity)
        self._judged_t_s = np.zeros(capacity)
        self._evidence = EvidenceStore(self._bank, config.evidence_readings)
        self._events = EventLog(self._vehicles, self._evidence, capacity)
        self._link_events = EventLog(self._vehicles, self._evidence, capacity, suffix="-link")
        self._misses = silence.MissLog(self._vehicles, capacity)
        self._ear = silence.Ear()
        self._first_heard_us = np.zeros(capacity, np.int64)
        self._restored_us = 0
        self._kept_house_us = 0

    @property
    def vehicles(self) -> int:
        """Vehicles known now."""
        return len(self._vehicles)

    @property
    def pairs(self) -> int:
        """Vehicles that follow somebody now."""
        return int((self._leaders(np.flatnonzero(self._vehicles.in_use)) >= 0).sum())

    @property
    def active_events(self) -> int:
        """Events under way."""
        return len(self._events) + len(self._link_events) + len(self._misses)

    def step(self, batch: Batch, now_us: int) -> Turn:
        """Judge a batch at local time `now_us` (Unix microseconds); an empty batch lets time pass.

        The order of the records within a batch is of no account: they are taken by event time.
        """
        outcomes = np.full(len(batch), Outcome.SCORED, np.uint8)
        tally = _Tally([], [])
        age_us = batch.received_us - batch.t_us
        outcomes[age_us > self._config.max_age_s * 1e6] = Outcome.TOO_OLD
        outcomes[age_us < -self._config.max_ahead_s * 1e6] = Outcome.FROM_THE_FUTURE
        rows = self._rows(batch, outcomes)
        taken = np.flatnonzero(outcomes == Outcome.SCORED)
        order = taken[np.lexsort((rows[taken], batch.t_us[taken]))]
        self._ear.hear(batch.received_us)
        for wave in _waves(rows, order):
            self._wave(batch, rows, wave, now_us, outcomes, tally)
        if now_us - self._kept_house_us >= HOUSEKEEPING_US:
            self._kept_house_us = now_us
            self._keep_house(now_us, tally)
        return Turn(
            outcomes=outcomes,
            events=tally.events,
            nis=np.concatenate(tally.nis) if tally.nis else np.empty(0),
            anomalous=tally.anomalous,
            missed_messages=tally.missed_messages,
            repairs=tally.repairs,
            restarts=tally.restarts,
            forgotten=tally.forgotten,
            leader_changes=tally.leader_changes,
        )

    def _rows(self, batch: Batch, outcomes: NDArray[np.uint8]) -> I64:
        """Return (B,) rows, giving one to each new vehicle; who finds no room is `TABLE_FULL`."""
        rows = self._vehicles.rows(batch.ids)
        strangers = np.flatnonzero((rows < 0) & (outcomes == Outcome.SCORED))
        if strangers.size:
            admitted = self._vehicles.admit({batch.ids[i] for i in strangers})
            self._first_heard_us[admitted] = batch.received_us[strangers].min()
            rows = self._vehicles.rows(batch.ids)
            outcomes[(rows < 0) & (outcomes == Outcome.SCORED)] = Outcome.TABLE_FULL
        return rows

    def _wave(
        self, batch: Batch, all_rows: I64, wave: I64, now_us: int, outcomes: NDArray[np.uint8], tally: _Tally
    ) -> None:
        """Take records of distinct vehicles through tracks, filter, pairing and events."""
        rows = all_rows[wave]
        heard_us, before_us = self._tracks["received_us"][rows], self._tracks["t_us"][rows]
        outcome = np.empty(rows.size, np.uint8)
        x_m, missed, began = np.empty(rows.size), np.empty(rows.size, np.int64), np.empty(rows.size, np.bool_)
        tracks.advance(
            self._tracks,
            rows,
            batch.t_us[wave],
            batch.received_us[wave],
            batch.msg_cnt[wave],
            batch.lat_deg[wave],
            batch.lon_deg[wave],
            batch.speed_mps[wave],
            batch.heading_deg[wave],
            batch.accuracy_m[wave],
            batch.length_m[wave],
            self._config.max_gap_s,
            outcome,
            x_m,
            missed,
            began,
        )
        outcomes[wave] = outcome
        self._bank[rows[began]] = 0
        self._evidence.forget(rows[began])
        tally.missed_messages += int(missed.sum())
        ok = outcome == Outcome.SCORED
        wave, rows, silent_us, heard_us = wave[ok], rows[ok], (batch.t_us[wave] - before_us)[ok], heard_us[ok]

        declared = self._vehicles.rows([batch.leader_ids[i] or "" for i in wave])
        readings, leaders = banks.readings(rows.size), np.empty(rows.size, np.int64)
        gather(
            self._tracks,
            self._pairing,
            self._judged_t_s,
            self._verdicts,
            rows,
            declared,
            wave,
            batch.range_m,
            batch.range_rate_mps,
            readings,
            leaders,
        )
        verdicts = banks.verdicts(rows.size)
        self._evidence.remember(self._bank, rows, readings, leaders)
        self._model.step_batch(self._bank["model"], rows, readings, self._model.params, verdicts)
        self._verdicts[rows] = verdicts
        self._judged_t_s[rows] = readings["t_s"]

        located = (verdicts["sensor"] & int(Sensor.LOCATION)) == 0
        tracks.leave_crumb(self._tracks, rows, located, verdicts["v_mps"])
        tally.leader_changes += pairing.look(
            self._tracks,
            self._pairing,
            self._grid,
            rows,
            declared,
            now_us,
            self._config.pairing_range_m,
            self._config.lane_width_m,
            np.empty(rows.size, np.bool_),
        )

        outcomes[wave[verdicts["warming"]]] = Outcome.WARMING
        tally.nis.append(verdicts["nis"][~verdicts["warming"]])
        tally.anomalous += int(verdicts["anomalous"].sum())
        tally.repairs += int(verdicts["repaired"].sum())
        tally.restarts += int(verdicts["restarted"].sum())
        t_us, received_us = batch.t_us[wave], batch.received_us[wave]
        tally.events += self._events.judge(rows, rows, leaders, t_us, received_us, verdicts)
        self._judge_links(rows, leaders, readings, verdicts, t_us, received_us, tally)
        self._heard_again(rows, leaders, silent_us, heard_us, t_us, received_us, tally)

    def _judge_links(
        self, rows: I64, leaders: I64, readings: Records, verdicts: Records, t_us: I64, received_us: I64, tally: _Tally
    ) -> None:
        """Test what the filter left standing of each reading against the car ahead; events name the suspect."""
        links = np.zeros(rows.size, LINK_VERDICT)
        step_links(self._bank["link"], rows, leaders, standing(readings, verdicts), self._link_params, links)
        concerned = np.flatnonzero((links["kind"] != Kind.NONE) | self._link_events.active[rows])
        if not concerned.size:
            return
        said, odds = link_said(links[concerned], verdicts[concerned]), links["follower_log_odds"][concerned]
        rows, leaders = rows[concerned], leaders[concerned]
        suspects = np.where((odds < 0.0) & (leaders >= 0), leaders, rows)
        tally.anomalous += int(said["anomalous"].sum())
        tally.events += self._link_events.judge(rows, suspects, leaders, t_us[concerned], received_us[concerned], said)

    def _heard_again(
        self, rows: I64, leaders: I64, silent_us: I64, heard_us: I64, t_us: I64, received_us: I64, tally: _Tally
    ) -> None:
        """End the misses of vehicles that are back, and state those that no neighbour could bear witness to.

        `silent_us` (B,) is the step in event time that brought each vehicle back.
        """
        limit = silence.limit_us(self._tracks["interval_s"][rows], self._config.miss_after_s)
        known = self._tracks["count"][rows] > self._config.warming_readings
        for i in np.flatnonzero(self._misses.active[rows] | (known & (silent_us > limit))):
            row, leader = int(rows[i]), int(leaders[i])
            if not self._misses.active[row]:
                if not self._ear.was_open(int(heard_us[i]), int(received_us[i])):
                    continue
                tally.events.append(self._misses.begin(row, leader, int(t_us[i]), int(heard_us[i])))
            tally.events.append(self._misses.end(row, leader, int(t_us[i]), int(received_us[i])))

    def _keep_house(self, now_us: int, tally: _Tally) -> None:
        """Look at who is silent, and forget who has been for long."""
        rows = np.flatnonzero(self._vehicles.in_use)
        heard_us = self._tracks["received_us"]
        leaders = self._leaders(rows)
        witness_us = silence.last_witness_us(heard_us, rows, leaders)
        limit = silence.limit_us(self._tracks["interval_s"][rows], self._config.miss_after_s)
        late = silence.late(now_us, heard_us[rows], witness_us, limit)
        late &= ~self._misses.active[rows] & (self._tracks["count"][rows] > self._config.warming_readings)
        late &= heard_us[rows] >= self._restored_us
        for i in np.flatnonzero(late):
            row = int(rows[i])
            if not self._renamed(row, rows):
                t_us = int(self._tracks["t_us"][row])
                tally.events.append(self._misses.begin(row, int(leaders[i]), t_us, int(heard_us[row])))
        gone = rows[now_us - heard_us[rows] > self._config.forget_after_s * 1e6]
        for row in gone:
            self._forget(int(row), tally)

    def _renamed(self, row: int, rows: I64) -> bool:
        """Whether a vehicle that began since is where this one would be by now: a change of pseudonym, not a miss."""
        track = self._tracks[row]
        fresh = rows[self._first_heard_us[rows] > track["received_us"]]
        others = self._tracks[fresh]
        east_per_deg, north_per_deg = metres_per_degree(float(track["lat_deg"]))
        ahead_m = track["v_mps"] * 1e-6 * (others["t_us"] - track["t_us"])
        east_m = (others["lon_deg"] - track["lon_deg"]) * east_per_deg - ahead_m * track["heading_east"]
        north_m = (others["lat_deg"] - track["lat_deg"]) * north_per_deg - ahead_m * track["heading_north"]
        off_m = np.hypot(east_m, north_m)
        return bool((off_m < RENAMED_WITHIN_M + RENAMED_SHARE * np.abs(ahead_m)).any())

    def _forget(self, row: int, tally: _Tally) -> None:
        """Free a row everywhere."""
        if self._misses.active[row]:
            track = self._tracks[row]
            tally.events.append(self._misses.end(row, -1, int(track["t_us"]), int(track["received_us"])))
        self._events.drop(row)
        self._link_events.drop(row)
        tracks.forget(self._tracks, np.array([row]))
        self._evidence.forget(np.array([row]))
        self._bank[row] = 0
        self._verdicts[row] = 0
        self._vehicles.forget(row)
        tally.forgotten += 1

    def _leaders(self, rows: I64) -> I64:
        """Return (B,) the row of each one's leader, NOBODY for none."""
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
            anomalous=self._events.active[rows] | self._link_events.active[rows],
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
            events=self._events.under_way(rows),
            link_events=self._link_events.under_way(rows),
            misses=self._misses.under_way(rows),
        )

    def restore(self, snapshot: Snapshot, now_us: int) -> int:
        """Go on with the vehicles of a snapshot that were heard within `forget_after_s`; return how many.

        This engine must not know any vehicle yet, and the snapshot must be of its configuration and of this core.
        Nobody is accused of the silence in between: it was ours.
        """
        heard_us = snapshot.tables["tracks"]["received_us"]
        newest = np.argsort(heard_us, kind="stable")[::-1]
        _, first = np.unique(np.array(snapshot.ids, dtype=np.str_)[newest], return_index=True)
        kept = newest[first]
        kept = np.sort(kept[now_us - heard_us[kept] <= self._config.forget_after_s * 1e6])
        rows = snapshot.rows[kept]
        self._vehicles.seat(rows, [snapshot.ids[i] for i in kept])
        for name, table in self._tables.items():
            table[rows] = snapshot.tables[name][kept]
        for column in ("leader_row", "challenger_row"):
            whom = self._pairing[column][rows]
            self._pairing[column][rows] = np.where(self._vehicles.in_use[whom], whom, pairing.NOBODY)
        self._events.resume([event for event in snapshot.events if self._vehicles.in_use[event.row]])
        self._link_events.resume([event for event in snapshot.link_events if self._vehicles.in_use[event.row]])
        self._misses.resume([miss for miss in snapshot.misses if self._vehicles.in_use[miss.row]])
        self._restored_us = now_us
        return int(rows.size)

    @property
    def _tables(self) -> dict[str, NDArray[Any]]:
        """What is kept of each row, by name, as far as a snapshot holds it."""
        return {
            "tracks": self._tracks,
            "pairing": self._pairing,
            "bank": self._bank,
            "verdicts": self._verdicts,
            "judged_t_s": self._judged_t_s,
            "first_heard_us": self._first_heard_us,
        }

    def warm_up(self) -> None:
        """Compile or load every kernel, on a vehicle pair of an engine of its own: this one stays as it is."""
        other = Engine(replace(self._config, vehicle_capacity=2))
        for k in range(2):
            other.step(_example(k), now_us=1 + k * 100_000)


def _waves(rows: I64, order: I64) -> list[I64]:
    """Split record indices, in order of event time, so that no vehicle occurs twice in one part."""
    if not order.size:
        return []
    ordered = rows[order]
    by_row = np.argsort(ordered, kind="stable")
    grouped = ordered[by_row]
    first = np.flatnonzero(np.r_[True, grouped[1:] != grouped[:-1]])
    if first.size == order.size:
        return [order]
    nth = np.empty(order.size, np.int64)
    nth[by_row] = np.arange(order.size) - np.repeat(first, np.diff(np.r_[first, order.size]))
    return [order[nth == n] for n in range(int(nth.max()) + 1)]


def _example(k: int) -> Batch:
    """Two vehicles 20 m apart going north, k tenths of a second on."""
    t_us = np.full(2, 1 + k * 100_000)
    nothing = np.full(2, np.nan)
    return Batch(
        ids=["leader", "follower"],
        leader_ids=[None, "leader"],
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
