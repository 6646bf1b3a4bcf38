"""The live door of the core: a batch of records in; the outcome of each, and the events they cause, out."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from headway.core.site.handover import adopt_state, disown, take_state
from headway.core.site.housekeeping import Housekeeping
from headway.core.site.pair_states import pair_states
from headway.core.site.passing_time import PassingTime
from headway.core.site.quality_states import quality_states
from headway.core.site.rounds import RoundProcessor, Slot
from headway.core.site.slot_end import SlotEnd
from headway.core.site.snapshots import restore_snapshot, take_snapshot
from headway.core.site.state import SiteState
from headway.core.tracking import reception
from headway.core.types.batch import Batch, columns
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.sensor_quality import QualityStates
from headway.core.types.snapshot import Snapshot
from headway.core.types.step_result import PairStates, RecordVerdicts, StepResult, StepTally
from headway.core.types.vehicle_state import VehicleState


class Engine:
    """The detector of one site. One thread at a time may call it."""

    def __init__(self, config: DetectorConfig) -> None:
        self._site = SiteState(config)
        self._slot_end = SlotEnd(self._site)
        self._housekeeping = Housekeeping(self._site)
        self._time = PassingTime(self._site, self._slot_end, self._housekeeping)
        self._rounds = RoundProcessor(self._site, self._slot_end)

    @property
    def vehicles(self) -> int:
        """Vehicles known now that this engine publishes."""
        owned = self._site.tables.owned
        return len(self._site.vehicles) - (owned.size - int(np.count_nonzero(owned)))

    @property
    def now_us(self) -> int:
        """Time until which it has processed: of the newest record or step."""
        return self._time.now_us

    @property
    def pairs(self) -> int:
        """Vehicles that have a leader, as of the last housekeeping; any thread may read it."""
        return self._housekeeping.pairs

    @property
    def active_events(self) -> int:
        """Open events."""
        return len(self._site.events) + len(self._site.pair_events) + len(self._site.misses)

    @property
    def open_event_ids(self) -> set[str]:
        """The `event_id` of each open event."""
        site, rows = self._site, self._site.owned_rows()
        logs = site.events.snapshot(rows), site.pair_events.snapshot(rows), site.misses.snapshot(rows)
        return {event.event_id for log in logs for event in log}

    def step(
        self,
        batch: Batch,
        now_us: int | None = None,
        clock_offset_us: int = 0,
        out: RecordVerdicts | None = None,
        owned: NDArray[np.bool_] | None = None,
    ) -> StepResult:
        """Process a batch in the order of arrival, then let time pass until local time `now_us` (microseconds).

        Without `now_us`, time passes until the newest record. Local time is that of `received_us` and never leaps. With
        `clock_offset_us` added it is Unix time, against which the age of a record is measured. The same records in
        other batches give the same results. `out`, if given, is filled with what was found of each record. `owned` (B,)
        is whether the vehicle of each record is of this engine, or of one beside it that publishes and counts it.
        """
        tally, outcomes = StepTally(), np.empty(len(batch), np.uint8)
        if len(batch):
            received_us, starts = self._time.receive(batch.received_us)
            whole = Slot(batch.ids, batch.leader_ids, columns(batch, received_us), outcomes, out, owned)
            for start, stop in pairwise([*starts, len(batch)]):
                self._time.pass_until(int(received_us[start]), tally)
                self._rounds.process(whole.part(start, stop) if len(starts) > 1 else whole, clock_offset_us, tally)
            self._time.pass_until(int(received_us[-1]), tally)
        if now_us is not None:
            self._time.pass_until(now_us, tally)
        return tally.result(outcomes)

    def ignore_gaps_before(self, until_us: int) -> None:
        """Start no miss for a silence before local time `until_us`: the service lost messages itself."""
        self._site.reception.ignore_gaps_before(until_us)

    def absent_until(self, until_us: int) -> None:
        """Let no vehicle be silent before local time `until_us`: the service could not receive at all.

        What is learnt of a vehicle is kept, however long that was.
        """
        self._site.reception.absent_until(until_us)

    def states(self, stride: int = 1, phase: int = 0) -> PairStates:
        """Return the vehicles of part `phase` of `stride` parts, as columns."""
        return pair_states(self._site, stride, phase)

    def qualities(self, stride: int = 1, phase: int = 0) -> QualityStates | None:
        """Return what is known of the sensors of the same vehicles; None where the model learns nothing of them."""
        return quality_states(self._site, stride, phase)

    def is_empty(self, stride: int, phase: int) -> bool:
        """Whether part `phase` of `stride` parts has no vehicle that this engine publishes."""
        return self._site.owned_rows(stride, phase).size == 0

    def snapshot(self, stride: int = 1, phase: int = 0) -> Snapshot:
        """Return copies of the state of the vehicles of part `phase` of `stride` parts.

        Parts of all phases, taken with steps between them, make a whole that `restore` accepts.
        """
        return take_snapshot(self._site, stride, phase)

    def restore(self, snapshot: Snapshot, now_us: int) -> int:
        """Continue with the vehicles of a snapshot; return how many.

        This engine must not know any vehicle yet. The snapshot must come from its configuration and from this version
        of the core. No vehicle is silent before `now_us`, because the service did not receive then.
        """
        vehicles = restore_snapshot(self._site, snapshot, now_us)
        self._time.start(now_us)
        self._slot_end.resume()
        self._housekeeping.count_pairs()
        return vehicles

    def state_of(self, vehicle: str) -> VehicleState | None:
        """Return the state of a vehicle, from which another engine continues; None if the vehicle is not known."""
        return take_state(self._site, vehicle)

    def release(self, vehicle: str) -> VehicleState | None:
        """Return the state of a vehicle for the engine that publishes it from now on; None if it is not known.

        Its open events end here without an update. It is judged on for its neighbours while its messages come.
        """
        state = take_state(self._site, vehicle)
        if state is not None:
            disown(self._site, vehicle)
        return state

    def adopt(self, state: VehicleState, *, owned: bool = True) -> bool:
        """Continue with a vehicle from its state, known here before or not; return whether there was room for it.

        The state must come from the configuration of this engine and from this version of the core. Its neighbours are
        those vehicles of the same id that are known here, so a leader should come before its followers.
        """
        row = adopt_state(self._site, state, owned=owned)
        if row is None:
            return False
        if self._time.now_us == 0:
            self._time.start(int(state.tables["tracks"]["received_us"][0]))
        self._slot_end.add_again(row)
        return True

    def warm_up(self) -> None:
        """Compile or load every kernel, on two vehicles of another engine: this one does not change."""
        other = Engine(replace(self._site.config, vehicle_capacity=2))
        for k in range(2):
            other._slot_end.resume()
            other.step(_example(k), now_us=1 + k * 100_000)
        other.states()
        site = other._site
        site.evidence.of(0)
        reception.pseudonym_changed(site.tables.tracks, site.first_received_us, 0, np.arange(2))
        site.evict(np.arange(1))


def _example(k: int) -> Batch:
    """Return two vehicles 20 m apart going north, at step k of 0.1 s."""
    t_us = np.full(2, 1 + k * 100_000)
    unknown = np.full(2, np.nan)
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
        accel_mps2=unknown,
        accuracy_m=unknown,
        length_m=unknown,
        range_m=unknown,
        range_rate_mps=unknown,
    )
