"""Counts of records by outcome: the source of the metrics and of the health report."""

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
    """Counts since the start; each received record is under exactly one `Outcome`."""

    def __init__(self) -> None:
        self._outcomes = np.zeros(_SIZE, dtype=np.int64)
        self.messages = 0
        """Payloads taken from the queue."""
        self.iterations = 0
        self.events: dict[tuple[Kind, Phase], int] = dict.fromkeys(product(KINDS, Phase), 0)
        """Event updates by kind and phase."""
        self.nis_below = 0
        """Scored readings with a NIS below the 95 % band. Far above 2.5 %: the filter expects too much noise."""
        self.nis_inside = 0
        self.nis_above = 0
        """Far above 2.5 % of clean readings: the filter expects too little noise."""
        self.anomalous = 0
        self.sequence_gap_messages = 0
        self.absent_s = 0.0
        """Time in which the service could not receive: without a bus, and before the start."""
        self.repairs = 0
        self.resets = 0
        self.restarts = 0
        self.evicted = 0
        self.leader_changes = 0
        self.copies_withheld = 0
        """Copies of rejected messages not published, to keep `rejected_rate_hz`."""

    def __getitem__(self, outcome: Outcome) -> int:
        """Return the number of records with this outcome."""
        return int(self._outcomes[outcome])

    @property
    def records(self) -> int:
        """Records under any outcome."""
        return int(self._outcomes.sum())

    @property
    def scored(self) -> int:
        """Records scored."""
        return self[Outcome.SCORED]

    @property
    def warming(self) -> int:
        """Records of vehicles with fewer than `warming_readings` readings."""
        return self[Outcome.WARMING]

    @property
    def rejected(self) -> dict[str, int]:
        """Rejected records by reason, for the reasons that occurred; shed records are lost, not rejected."""
        return {o.label: self[o] for o in Outcome if o.is_rejection and o not in LOSSES and self[o]}

    @property
    def lost(self) -> dict[str, int]:
        """Records received but never decoded, by reason."""
        return {reason.label: self[reason] for reason in LOSSES}

    def record(
        self, messages: int, rejections: list[Rejection], result: StepResult, shed: Mapping[Outcome, int]
    ) -> None:
        """Count one iteration; `shed` are the counts of the bus since the start."""
        self.iterations += 1
        self.messages += messages
        for reason, records in shed.items():
            self._outcomes[int(reason)] = records  # numpy looks into an Enum for 10 us
        for rejection in rejections:
            self._outcomes[int(rejection.reason.outcome)] += rejection.count
        if result.outcomes.size:
            self._outcomes += np.bincount(result.outcomes, minlength=_SIZE)
            self._record_nis(result.nis)
        for event in result.events:
            self.events[event.kind, event.phase] += 1
        self.anomalous += result.anomalous
        self.sequence_gap_messages += result.sequence_gaps
        self.repairs += result.repairs
        self.resets += result.resets
        self.restarts += result.restarts
        self.evicted += result.evicted
        self.leader_changes += result.leader_changes

    def _record_nis(self, nis: NDArray[np.float64]) -> None:
        below = int(np.count_nonzero(nis < NIS_BAND[0]))
        above = int(np.count_nonzero(nis > NIS_BAND[1]))
        self.nis_below += below
        self.nis_above += above
        self.nis_inside += nis.size - below - above
