"""What the service tells systemd: that it is ready, that it lives, and that it stops (sd_notify(3))."""

import socket
from collections.abc import Mapping
from contextlib import suppress
from typing import Final

from headway.edge.clock import Clock

_PER_TIMEOUT: Final = 3
"""Signs of life within the time after which systemd ends the process."""


class ServiceManager:
    """A datagram to systemd for each state; without systemd none is sent.

    Parameters
    ----------
    environment
        Where systemd names its socket (NOTIFY_SOCKET, an abstract one with @) and its watchdog (WATCHDOG_USEC).
    """

    def __init__(self, clock: Clock, environment: Mapping[str, str]) -> None:
        self._clock = clock
        address = environment.get("NOTIFY_SOCKET", "")
        self._address = f"\0{address[1:]}" if address.startswith("@") else address
        self._interval_ns = int(environment.get("WATCHDOG_USEC", 0)) * 1_000 // _PER_TIMEOUT
        self._due_ns = 0
        self._is_ready_sent = False

    def tell(self, *, is_ready: bool) -> None:
        """Tell once that messages are received and processed, and as often as the watchdog needs it that it lives."""
        if is_ready and not self._is_ready_sent:
            self._is_ready_sent = True
            self._notify("READY=1")
        if self._interval_ns and (now_ns := self._clock.monotonic_ns()) >= self._due_ns:
            self._due_ns = now_ns + self._interval_ns
            self._notify("WATCHDOG=1")

    def stopping(self) -> None:
        """Tell that the process ends by itself."""
        self._notify("STOPPING=1")

    def _notify(self, state: str) -> None:
        if self._address:
            with suppress(OSError), socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as datagrams:
                datagrams.sendto(state.encode(), self._address)
