"""One publisher for each site of a fleet: a service holds an epoch, and the service of a higher one replaces it.

The epoch of a site only rises. It is in a file that all services of the site reach, and in a liveliness token on the
bus. A service may publish for `lease_s` after it last read its own epoch in the file. When it reads a higher one, it
stops in order within that time, and writes that it released its epoch. The service that replaces it waits for that, or
for `lease_s`, before it publishes. So a process that was stopped for longer publishes nothing when it continues.

Where the service before has failed, its epoch is ended by a reservation of the next one. The lease runs while the next
service starts.
"""

import fcntl
import os
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

import structlog

from headway.edge.clock import Clock
from headway.errors import UserError

REPLACED: Final = "replaced"
"""A service with a higher epoch takes over the site."""
LEASE_EXPIRED: Final = "lease_expired"
"""The epoch was not read for longer than the lease: the process or the folder did not answer."""
_LOOKS: Final = 4
"""Looks at the file within one lease."""
_POLL_S: Final = 0.02
"""How often the next service looks whether the one before has released its epoch."""
_RESERVED: Final = "reserved"

_log: Final = structlog.get_logger(__name__)


class SupersededError(UserError):
    """The epoch is not higher than the one before."""

    status = 3


def end_process(reason: str) -> None:
    """End at once: no queue is emptied, no snapshot written."""
    _log.error("no longer the publisher of this site", reason=reason)
    os._exit(SupersededError.status)


def newest_epoch(file: Path) -> int:
    """Return the highest epoch of a site, 0 before the first. Raises `OSError` or `ValueError`."""
    return _read(file)[0]


def reserve(file: Path, epoch: int) -> None:
    """End each lower epoch of a site, for a service that will claim this one.

    Raises
    ------
    SupersededError
        The file holds this epoch or a higher one.
    """
    with _locked(file):
        before, _ = _read(file)
        if before >= epoch:
            raise SupersededError(f"epoch {epoch}: {file} has {before}")
        _write(file, f"{epoch} {_RESERVED}")


class Fence:
    """The right to publish for a site, which ends once and for all.

    Parameters
    ----------
    file
        Holds the highest epoch of the site. Its folder is created.
    epoch
        Number of this service, above that of each earlier one.
    replaced
        Called once when a service of a higher epoch waits; this one has the rest of its lease to stop and `release`.
    lost
        Called with the reason whenever the right is found to have ended; any thread may call it.
    """

    def __init__(
        self,
        file: Path,
        epoch: int,
        lease_s: float,
        clock: Clock,
        replaced: Callable[[], None],
        lost: Callable[[str], None] = end_process,
    ) -> None:
        self.epoch = epoch
        self.lease_s = lease_s
        self.is_replaced = False
        self._file = file
        self._released = file.with_suffix(".released")
        self._clock = clock
        self._replaced = replaced
        self._lost = lost
        self._has_ended = self._is_held = False
        self._started_ns = self._confirmed_ns = clock.monotonic_ns()
        try:
            self._was_reserved = _read(file) == (epoch, True)
        except (OSError, ValueError):  # `claim` says so
            self._was_reserved = False
        self._closed = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="headway-fence", daemon=True)

    def claim(self) -> None:
        """Write the epoch, begin to watch it, and wait until an earlier service has released its own, or the lease.

        Raises
        ------
        SupersededError
            The file holds this epoch or a higher one.
        UserError
            The file cannot be read or written.
        """
        try:
            with _locked(self._file):
                before, is_reserved = _read(self._file)
                if before > self.epoch or (before == self.epoch and not is_reserved):
                    raise SupersededError(f"epoch {self.epoch}: {self._file} has {before}; start with a higher one")
                _write(self._file, str(self.epoch))
        except (OSError, ValueError) as error:
            raise UserError(f"{self._file}: {error}; a service with an epoch needs this file") from None
        self._confirmed_ns = self._clock.monotonic_ns()
        self._thread.start()
        since_ns = self._started_ns if self._was_reserved else self._confirmed_ns
        while before and not self._is_released(before) and self._clock.monotonic_ns() < since_ns + self.lease_s * 1e9:
            self._clock.sleep(_POLL_S)
        self._is_held = True

    def permits(self) -> bool:
        """Whether the service may publish now; if not, tell the reason."""
        if not self._has_ended and self._clock.monotonic_ns() - self._confirmed_ns > self.lease_s * 1e9:
            self._has_ended = True
        if self._has_ended:
            self._lost(REPLACED if self.is_replaced else LEASE_EXPIRED)
        return not self._has_ended

    def see(self, epoch: int) -> None:
        """Take an epoch of this site that another service holds."""
        if epoch > self.epoch and self.permits() and not self.is_replaced:
            self.is_replaced = True
            _log.warning("no longer the publisher of this site", reason=REPLACED, epoch=epoch)
            self._replaced()

    def look(self) -> None:
        """Read the file; while it cannot be read, or has another epoch, the lease runs."""
        before_ns = self._clock.monotonic_ns()
        try:
            epoch, _ = _read(self._file)
        except (OSError, ValueError):
            epoch = 0
        if self.permits():
            self.see(epoch)
            if epoch == self.epoch and not self.is_replaced:
                self._confirmed_ns = before_ns

    def release(self) -> None:
        """Publish no more, and let the next service begin without a wait."""
        self._closed.set()
        if self._is_held and not self._has_ended:
            try:
                _write(self._released, str(self.epoch))
            except OSError as error:
                _log.warning("epoch not released; the next service waits", error=str(error))
        self._has_ended = True

    def _is_released(self, epoch: int) -> bool:
        try:
            return _read(self._released)[0] >= epoch
        except (OSError, ValueError):
            return False

    def _watch(self) -> None:
        while not self._closed.wait(self.lease_s / _LOOKS):
            self.look()


@contextmanager
def _locked(file: Path) -> Iterator[None]:
    file.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
    with file.with_suffix(".epoch-lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def _read(file: Path) -> tuple[int, bool]:
    """Return the epoch and whether it is only reserved; 0 without a file."""
    try:
        epoch, _, mark = file.read_text(encoding="ascii").partition(" ")
    except FileNotFoundError:
        return 0, False
    return int(epoch), mark == _RESERVED


def _write(file: Path, text: str) -> None:
    new = file.with_suffix(file.suffix + "-new")
    with new.open("w", encoding="ascii") as opened:
        opened.write(text)
        opened.flush()
        os.fsync(opened.fileno())
    new.replace(file)
