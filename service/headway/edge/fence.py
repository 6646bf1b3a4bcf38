"""One publisher for each site of a fleet: a service holds an epoch, and the service of a higher one replaces it.

The epoch of a site only rises. It is in a file that all services of the site reach, and in a liveliness token on the
bus. A service may publish for `lease_s` after it last read its own epoch in the file. The service that replaces it
waits that long before it publishes. So a process that was stopped for longer publishes nothing when it continues.
"""

import fcntl
import os
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Final

import structlog

from headway.edge.clock import Clock
from headway.errors import UserError

REPLACED: Final = "replaced"
"""A service with a higher epoch judges the site."""
LEASE_EXPIRED: Final = "lease_expired"
"""The epoch was not read for longer than the lease: the process or the folder did not answer."""
_LOOKS: Final = 4
"""Looks at the file within one lease."""

_log: Final = structlog.get_logger(__name__)


class SupersededError(UserError):
    """The epoch is not higher than the one before."""

    status = 3


def end_process(reason: str) -> None:
    """End at once: no queue is emptied, no snapshot written."""
    _log.error("no longer the publisher of this site", reason=reason)
    os._exit(SupersededError.status)


class Fence:
    """The right to publish for a site, which ends once and for all.

    Parameters
    ----------
    file
        Holds the highest epoch of the site. Its folder is created.
    epoch
        Number of this service, above that of each earlier one.
    lost
        Called with the reason whenever the right is found to have ended; any thread may call it.
    """

    def __init__(
        self, file: Path, epoch: int, lease_s: float, clock: Clock, lost: Callable[[str], None] = end_process
    ) -> None:
        self.epoch = epoch
        self.lease_s = lease_s
        self._file = file
        self._clock = clock
        self._lost = lost
        self._reason: str | None = None
        self._confirmed_ns = clock.monotonic_ns()
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="headway-fence", daemon=True)

    def claim(self) -> None:
        """Write the epoch, begin to watch it, and wait until the lease of an earlier service has ended.

        Raises
        ------
        SupersededError
            The file holds this epoch or a higher one.
        UserError
            The file cannot be read or written.
        """
        try:
            self._file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            with self._file.with_suffix(".epoch-lock").open("w") as lock:
                fcntl.flock(lock, fcntl.LOCK_EX)
                before = self._read() if self._file.exists() else 0
                if before >= self.epoch:
                    raise SupersededError(f"epoch {self.epoch}: {self._file} has {before}; start with a higher one")
                self._write()
        except (OSError, ValueError) as error:
            raise UserError(f"{self._file}: {error}; a service with an epoch needs this file") from None
        self._confirmed_ns = self._clock.monotonic_ns()
        self._thread.start()
        if before:
            self._clock.sleep(self.lease_s)

    def permits(self) -> bool:
        """Whether the service may publish now; if not, tell the reason."""
        if self._reason is None and self._clock.monotonic_ns() - self._confirmed_ns > self.lease_s * 1e9:
            self._reason = LEASE_EXPIRED
        if self._reason is not None:
            self._lost(self._reason)
        return self._reason is None

    def see(self, epoch: int) -> None:
        """Take an epoch of this site that another service holds."""
        if epoch > self.epoch:
            self._reason = self._reason or REPLACED
            self._lost(self._reason)

    def look(self) -> None:
        """Read the file; while it cannot be read, the lease runs."""
        before_ns = self._clock.monotonic_ns()
        try:
            epoch = self._read()
        except (OSError, ValueError):
            epoch = 0
        self.see(epoch)
        if self.permits() and epoch == self.epoch:
            self._confirmed_ns = before_ns

    def close(self) -> None:
        """Watch no more."""
        self._closed.set()

    def _watch(self) -> None:
        while not self._closed.wait(self.lease_s / _LOOKS):
            self.look()

    def _read(self) -> int:
        return int(self._file.read_text(encoding="ascii"))

    def _write(self) -> None:
        new = self._file.with_suffix(".epoch-new")
        with new.open("w", encoding="ascii") as file:
            file.write(str(self.epoch))
            file.flush()
            os.fsync(file.fileno())
        new.replace(self._file)
