"""A received message, and why one is rejected."""

from dataclasses import dataclass
from typing import NamedTuple

from headway.core.types.outcome import Outcome


class ReceivedMessage(NamedTuple):
    """One message as the bus delivered it, stamped on receipt."""

    key: str
    payload: bytes
    encoding: str
    is_put: bool
    received_us: int
    """Microseconds of Unix time."""
    received_ns: int
    """Monotonic clock, for durations."""


class RejectReason(NamedTuple):
    """Why a record is rejected; `detail` holds no text of the sender."""

    outcome: Outcome
    detail: str


@dataclass(frozen=True, slots=True)
class Rejection:
    """A record, or a whole payload, that is rejected."""

    reason: RejectReason
    message: ReceivedMessage
    index: int | None = None
    """Index of the record in the payload, from 0; None: the payload as a whole."""
    count: int = 1
    """Records that it stands for: one where the records of a payload cannot be counted."""
