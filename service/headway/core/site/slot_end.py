"""What is done between two slots of reception: coverage, and the search for leaders, of the vehicles that are due."""

import numpy as np
from numba import njit

from headway.core.pipeline.ordering import SLOT_US
from headway.core.pipeline.tables import RoundParams, Tables
from headway.core.runtime.bound_kernel import bind_signature
from headway.core.site.state import SiteState
from headway.core.tracking.coverage import enter_cell, judge_appearance
from headway.core.tracking.pairing import NO_LEADER, find_leaders
from headway.core.types.batch import I64
from headway.core.types.step_result import StepTally


@njit(cache=True, error_model="numpy")
def end_slot(
    tables: Tables, rows: I64, declared_rows: I64, now_us: int, receiving_since_us: int, params: RoundParams
) -> int:
    """Enter the cell of each of `rows` (n,) and search its leader, both in this order; return how many changed.

    Vehicles of other engines are not counted.
    """
    for i in range(rows.size):
        enter_cell(tables.coverage, tables.tracks[rows[i]])
        judge_appearance(tables.tracks, rows[i], now_us, receiving_since_us)
    changed = np.empty(rows.size, np.bool_)
    find_leaders(
        tables.tracks,
        tables.pairing,
        tables.grid,
        rows,
        declared_rows,
        now_us,
        params.pairing_range_m,
        params.lane_width_m,
        changed,
    )
    return int((changed & tables.owned[rows]).sum())


class SlotEnd:
    """Collects the vehicles that are due until the end of their slot."""

    def __init__(self, site: SiteState) -> None:
        self._site = site
        self._end_slot = bind_signature(end_slot)
        self._due: list[I64] = []

    @property
    def is_due(self) -> bool:
        """Whether any vehicle is due."""
        return bool(self._due)

    def add(self, rows: I64, declared_rows: I64) -> None:
        """Add vehicles whose search is due, and the rows (n,) of the leaders that they declare."""
        self._due.append(rows)
        self._site.declared_rows[rows] = declared_rows

    def add_again(self, row: int) -> None:
        """Add a vehicle whose search may be due: if it is not, it is passed over."""
        self._due.append(np.array([row]))

    def resume(self) -> None:
        """Go on with the vehicles of a snapshot, as if all were due: those that are not are passed over."""
        self._due = [self._site.rows()]

    def run(self, now_us: int, tally: StepTally) -> None:
        """End the slot before `now_us`. A declared leader first received in it is none: batches must have no effect."""
        site, rows = self._site, np.concatenate(self._due)
        self._due.clear()
        tracks, pairing = site.tables.tracks, site.tables.pairing
        # Two vehicles may be searched that concern each other, so the order is that of their messages, not of rows.
        rows = rows[np.lexsort((pairing["phase_us"][rows], tracks["t_us"][rows]))]
        declared = site.declared_rows[rows]
        declared[site.first_received_us[declared] >= now_us - SLOT_US] = NO_LEADER
        since_us = max(site.reception.receiving_since_us, site.reception.outage_until_us)
        tally.leader_changes += self._end_slot(site.tables, rows, declared, now_us, since_us, site.params)
