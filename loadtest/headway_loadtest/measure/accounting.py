"""Every message by name: what was sent is scored, warming, rejected for a reason, lost for a reason, or unaccounted."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Self

TRANSPORT = "transport"


@dataclass(frozen=True, slots=True)
class Counters:
    """Counts of the service, in records since its start. `sequence_gaps` are gaps in the senders' counters."""

    scored: int
    warming: int
    rejected: Mapping[str, int]
    lost: Mapping[str, int]
    sequence_gaps: int
    queued: int

    @classmethod
    def of(cls, health: Mapping[str, Any]) -> Self:
        """Read the counters of a health message."""
        return cls(
            scored=health["scored"],
            warming=health["warming"],
            rejected=health["rejected"],
            lost=health["lost"],
            sequence_gaps=health.get("sequence_gap_messages", 0),
            queued=health["queue_depth"],
        )

    @property
    def outcomes(self) -> int:
        """Records under any outcome."""
        return self.scored + self.warming + sum(self.rejected.values()) + sum(self.lost.values())


@dataclass(frozen=True, slots=True)
class Ledger:
    """One run, in records. `unaccounted` is below 0 when others sent to the service meanwhile."""

    sent: int
    scored: int
    warming: int
    rejected: Mapping[str, int]
    lost: Mapping[str, int]

    @property
    def unaccounted(self) -> int:
        """Records without an outcome and without a reason."""
        return self.sent - self.scored - self.warming - sum(self.rejected.values()) - sum(self.lost.values())


def reconcile(sent: int, unsent: Mapping[str, int], before: Counters, after: Counters) -> Ledger:
    """Reconcile a run over `sent` records, `unsent` of them by reason never put.

    Lost in transport is only what the counters of the senders prove: gaps that the service saw, less what it shed or
    rejected itself, because that leaves gaps too. What is missing beyond that stays unaccounted.
    """
    rejected = _since(before.rejected, after.rejected)
    lost = _since(before.lost, after.lost)
    scored, warming = after.scored - before.scored, after.warming - before.warming
    put = sent - sum(unsent.values())
    missing = put - scored - warming - sum(rejected.values()) - sum(lost.values())
    proven = (
        after.sequence_gaps - before.sequence_gaps - sum(lost.values()) - sum(rejected.values()) - sum(unsent.values())
    )
    transport = max(0, min(missing, proven))
    named = {**lost, **({TRANSPORT: transport} if transport else {}), **{k: n for k, n in unsent.items() if n}}
    return Ledger(sent=sent, scored=scored, warming=warming, rejected=rejected, lost=named)


def _since(before: Mapping[str, int], after: Mapping[str, int]) -> dict[str, int]:
    change = {reason: count - before.get(reason, 0) for reason, count in after.items()}
    return {reason: count for reason, count in sorted(change.items()) if count}
