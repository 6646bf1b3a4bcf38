"""What comes from the bus, and what is said of it when it cannot be judged."""

from dataclasses import dataclass
from typing import NamedTuple

from headway.core.types.outcome import Outcome


class Arrival(NamedTuple):
    """One message as the bus delivered it, stamped on receipt."""

    key: str
    payload: bytes
    encoding: str
    is_put: bool
    received_us: int
    """Microseconds of Unix time."""
    received_ns: int
    """Monotonic clock, for durations."""


class Fault(NamedTuple):
    """Why a record cannot be judged; `detail` holds nothing that the sender wrote."""

    reason: Outcome
    detail: str


@dataclass(frozen=True, slots=True)
class Rejection:
    """A record, or a whole payload, that is not judged."""

    fault: Fault
    arrival: Arrival
    index: int | None = None
    """Which record of the payload, from 0; None: the payload as a whole."""
    count: int = 1
    """How many records it stands for: one for a payload whose records nobody can count."""
