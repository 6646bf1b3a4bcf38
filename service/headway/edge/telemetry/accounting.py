"""What became of everything that came in: the one source of the metrics and of the health topic."""

import math
from collections.abc import Mapping
from itertools import product

import numpy as np
from numpy.typing import NDArray

from headway.core.types.outcome import LOSSES, Outcome
from headway.core.types.records import Kind
from headway.core.types.step_result import Phase, StepResult
from headway.edge.transport.message import Rejection

_SIZE = max(Outcome) + 1
NIS_BAND = (-2 * math.log(0.975), -2 * math.log(0.025))
"""Quantiles 0.025 and 0.975 of the chi-square distribution with two degrees of freedom, F(x) = 1 - exp(-x/2)."""
KINDS = tuple(kind for kind in Kind if kind is not Kind.NONE)
"""Kinds that an event may have."""


class Ledger:
    """Counts since the start; every record that came in is under exactly one `Outcome`."""

    def __init__(self) -> None:
        self._outcomes = np.zeros(_SIZE, dtype=np.int64)
        self.messages = 0
        """Payloads taken from the queue."""
        self.turns = 0
        self.events: dict[tuple[Kind, Phase], int] = dict.fromkeys(product(KINDS, Phase), 0)
        """Statements by kind and phase."""
        self.nis_below = 0
        """Scored readings whose nis lies below the 95 % band; well above 2.5 % of them, the filter is too cautious."""
        self.nis_inside = 0
        self.nis_above = 0
        """Well above 2.5 % of clean readings, the filter is too sure of itself."""
        self.anomalous = 0
        self.missed_messages = 0
        self.repairs = 0
        self.restarts = 0
        self.forgotten = 0
        self.leader_changes = 0
        self.copies_withheld = 0
        """Copies of rejected messages not told, to keep their rate."""

    def __getitem__(self, outcome: Outcome) -> int:
        """Return how many records ended so."""
        return int(self._outcomes[outcome])

    @property
    def records(self) -> int:
        """Records under any outcome."""
        return int(self._outcomes.sum())

    @property
    def scored(self) -> int:
        """Records judged."""
        return self[Outcome.SCORED]

    @property
    def warming(self) -> int:
        """Records of vehicles not known for long enough."""
        return self[Outcome.WARMING]

    @property
    def rejected(self) -> dict[str, int]:
        """Records by reason, for the reasons that occurred; those never looked at are not rejected but lost."""
        return {o.label: self[o] for o in Outcome if o.is_rejection and o not in LOSSES and self[o]}

    @property
    def lost(self) -> dict[str, int]:
        """Records that came in and were never looked at."""
        return {reason.label: self[reason] for reason in LOSSES}

    def book(self, messages: int, rejections: list[Rejection], turn: StepResult, shed: Mapping[Outcome, int]) -> None:
        """Enter one turn; `shed` are the bus's counts of records since the start."""
        self.turns += 1
        self.messages += messages
        for reason, records in shed.items():
            self._outcomes[reason] = records
        for rejection in rejections:
            self._outcomes[rejection.fault.reason] += rejection.count
        if turn.outcomes.size:
            self._outcomes += np.bincount(turn.outcomes, minlength=_SIZE)
            self._book_nis(turn.nis)
        for event in turn.events:
            self.events[event.kind, event.phase] += 1
        self.anomalous += turn.anomalous
        self.missed_messages += turn.sequence_gaps
        self.repairs += turn.repairs
        self.restarts += turn.restarts
        self.forgotten += turn.evicted
        self.leader_changes += turn.leader_changes

    def _book_nis(self, nis: NDArray[np.float64]) -> None:
        below = int(np.count_nonzero(nis < NIS_BAND[0]))
        above = int(np.count_nonzero(nis > NIS_BAND[1]))
        self.nis_below += below
        self.nis_above += above
        self.nis_inside += nis.size - below - above
