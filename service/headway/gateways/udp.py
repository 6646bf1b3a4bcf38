"""Packets of roadside units over UDP.

A unit forwards what it receives by radio as the text of an immediate forward message (RSU 4.1, port 1516), or as bare
octets, as to the ports of the ODE. The decoder finds the frame within, so a packet goes onto the bus as it came.
"""

import os
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

from headway.errors import UserError
from headway.gateways.frame_queue import FrameQueue
from headway_schemas.frames import Frame

PORTS: Final = (1516, 46800, 44990)
"""Immediate forward, BSM of the ODE, mixed types of the ODE."""
_BUFFER_BYTES: Final = 8 << 20
"""Of the socket: some ten thousand packets; the system may grant less."""
_PACKET_BYTES_MAX: Final = 65_535
_AT_ONCE: Final = 4_096
_POLL_S: Final = 0.1
_GATHER_S: Final = 0.002
"""Pause in which packets gather in the socket: to wake up for each one costs four times as much as to read it."""
_ADDRESSES_MAX: Final = 4_096
SO_RCVBUFFORCE: Final = 33
"""Of Linux, for a process that may; Python has no name for it."""


class UdpReceiver:
    """Receives on some ports of one address.

    Raises
    ------
    UserError
        A port is not available.
    """

    connection = None

    def __init__(self, queue: FrameQueue, host: str, ports: Sequence[int]) -> None:
        self._queue = queue
        self._selector = selectors.DefaultSelector()
        self._sockets = [_bound(host, port) for port in ports]
        self._names: dict[tuple[str, int], str] = {}
        for one in self._sockets:
            self._selector.register(one, selectors.EVENT_READ)

    @property
    def ports(self) -> list[int]:
        """Ports that it receives on."""
        return [one.getsockname()[1] for one in self._sockets]

    @property
    def lost(self) -> int:
        """Packets that the system dropped because a socket was full."""
        inodes = {str(os.fstat(one.fileno()).st_ino) for one in self._sockets}
        lost = 0
        for table in ("/proc/net/udp", "/proc/net/udp6"):
            with suppress(OSError):
                rows = map(str.split, Path(table).read_text(encoding="ascii").splitlines()[1:])
                lost += sum(int(row[12]) for row in rows if row[9] in inodes)
        return lost

    @property
    def problem(self) -> str | None:
        """None: a bound port can always receive."""
        return None

    def run(self, stopping: Callable[[], bool]) -> None:
        """Receive until it is stopped."""
        while not stopping():
            ready = self._selector.select(_POLL_S)
            for key, _ in ready:
                self._receive(key.fileobj)  # type: ignore[arg-type]
            if ready:
                time.sleep(_GATHER_S)

    def close(self) -> None:
        """Release the ports."""
        self._selector.close()
        for one in self._sockets:
            one.close()

    def _receive(self, ready: socket.socket) -> None:
        received_us = time.time_ns() // 1000
        frames: list[Frame] = []
        with suppress(BlockingIOError):
            while len(frames) < _AT_ONCE:
                payload, address = ready.recvfrom(_PACKET_BYTES_MAX)
                frames.append(Frame(payload, received_us, self._names.get(address) or self._name(address)))
        self._queue.put(frames)

    def _name(self, address: tuple[str, int]) -> str:
        if len(self._names) >= _ADDRESSES_MAX:
            self._names.clear()
        return self._names.setdefault(address, str(address[0]))


def _bound(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    one = socket.socket(family, socket.SOCK_DGRAM)
    one.setblocking(False)  # noqa: FBT003 - of the standard library
    for option in (SO_RCVBUFFORCE, socket.SO_RCVBUF):
        with suppress(OSError):
            one.setsockopt(socket.SOL_SOCKET, option, _BUFFER_BYTES)
            break
    try:
        one.bind((host, port))
    except OSError as error:
        one.close()
        raise UserError(f"UDP {host}:{port}: {error.strerror or error}") from None
    return one
