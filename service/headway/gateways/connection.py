"""The state of a connection to a broker: how often it was lost, for how long, and whether the broker forgot."""

import time
from dataclasses import dataclass, field
from typing import Final

import structlog

_log: Final = structlog.get_logger(__name__)


@dataclass(slots=True)
class Connection:
    """Kept by a feed. What was sent in an absence arrives after it, if the broker kept the session of the gateway."""

    is_up: bool = False
    disconnections: int = 0
    sessions_lost: int = 0
    """Times at which the broker had lost the session of the gateway, and with it the messages of the absence."""
    _absent_s: float = 0.0
    _since_ns: int = field(default_factory=time.monotonic_ns)

    @property
    def absent_s(self) -> float:
        """Seconds without the broker, since the first connection."""
        return self._absent_s + (self._current_s() if self.disconnections and not self.is_up else 0.0)

    def up(self) -> None:
        """Note that the broker answers."""
        if self.is_up:
            return
        self.is_up = True
        if self.disconnections:
            self._absent_s += (seconds := self._current_s())
            _log.warning("broker back", absent_s=round(seconds, 3))

    def down(self, reason: str) -> None:
        """Note that it does not."""
        if not self.is_up:
            return
        self.is_up = False
        self.disconnections += 1
        self._since_ns = time.monotonic_ns()
        _log.warning("broker lost", reason=reason, disconnections=self.disconnections)

    def session_lost(self) -> None:
        """Note that the broker has lost what it kept for the gateway."""
        self.sessions_lost += 1
        _log.warning("the broker kept nothing: what was sent in the absence is lost", absent_s=round(self.absent_s, 3))

    def _current_s(self) -> float:
        return (time.monotonic_ns() - self._since_ns) / 1e9
