"""Whether a view has a bus at all, for whoever started it."""

import sys
import time
from collections.abc import Callable, Sequence
from typing import Final, TextIO

PATIENCE_S: Final = 2.0
"""A bus that is there answers within this time."""


class ContactNotice:
    """Says on standard error that the bus does not answer, and later that it does: once each."""

    def __init__(
        self,
        view: str,
        endpoints: Sequence[str],
        *,
        to: TextIO | None = None,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._view = view
        self._where = ", ".join(endpoints) or "the endpoints of the zenoh configuration"
        self._to = to or sys.stderr
        self._now_s = now_s
        self._last_contact_s = now_s()
        self._waiting = False

    def update(self, *, connected: bool) -> None:
        """Take note of the state of the connection, now."""
        now_s = self._now_s()
        if connected:
            self._last_contact_s = now_s
        waiting = not connected and now_s - self._last_contact_s >= PATIENCE_S
        if waiting and not self._waiting:
            self._say(f"no contact with {self._where}; is `headway serve` running? Waiting for it.")
        elif self._waiting and not waiting:
            self._say(f"connected to {self._where}")
        self._waiting = waiting

    def _say(self, what: str) -> None:
        self._to.write(f"headway {self._view}: {what}\n")
        self._to.flush()
