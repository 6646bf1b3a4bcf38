"""How time passes for a site: by the receive times of its records and the local time, in slots."""

import numpy as np

from headway.core.pipeline.ordering import CLOCK_SET_BACK_US, SLOT_US, receive_times
from headway.core.runtime.bound_kernel import bind_signature
from headway.core.site.housekeeping import Housekeeping
from headway.core.site.slot_end import SlotEnd
from headway.core.site.state import SiteState
from headway.core.types.batch import I64
from headway.core.types.step_result import StepTally

HOUSEKEEPING_SLOTS = 10
"""Slots between two runs of housekeeping: 0.1 s."""


class PassingTime:
    """The newest time of one site, and what its passing brings about."""

    def __init__(self, site: SiteState, slot_end: SlotEnd, housekeeping: Housekeeping) -> None:
        self._site = site
        self._slot_end = slot_end
        self._housekeeping = housekeeping
        self._receive_times = bind_signature(receive_times)
        self.now_us = 0
        """Of the newest record or step; it goes back only when the clock is set back."""
        self._slot = 0

    def start(self, now_us: int) -> None:
        """Start at `now_us`, at the end of the slot before: earlier time does not pass."""
        self.now_us, self._slot = now_us, now_us // SLOT_US - 1

    def receive(self, received_us: I64) -> tuple[I64, list[int]]:
        """Return (B,) times of reception that do not go back, and the place of the first record of each slot."""
        times_us, starts = np.empty(received_us.size, np.int64), np.empty(received_us.size, np.int64)
        count = self._receive_times(np.ascontiguousarray(received_us), self.now_us, times_us, starts)
        return times_us, starts[:count].tolist()

    def pass_until(self, now_us: int, tally: StepTally) -> None:
        """Search leaders after each slot up to `now_us` with records in it, and run housekeeping every tenth slot."""
        if self.now_us - CLOCK_SET_BACK_US <= now_us < self.now_us:
            return
        self.now_us, last_slot = now_us, now_us // SLOT_US
        if last_slot == self._slot:
            return
        if not self._site.vehicles or last_slot < self._slot:
            self._slot = last_slot
        while self._slot < last_slot:
            is_due = self._slot_end.is_due
            self._slot += 1 if is_due else HOUSEKEEPING_SLOTS - self._slot % HOUSEKEEPING_SLOTS
            self._slot = min(self._slot, last_slot)
            if is_due:
                self._slot_end.run(self._slot * SLOT_US, tally)
            if self._slot % HOUSEKEEPING_SLOTS == 0:
                self._housekeeping.run(self._slot * SLOT_US, tally)
                if not self._site.vehicles:
                    self._slot = last_slot
