"""The TCP connections of this process, and whether they linger when they are closed."""

import socket
from contextlib import suppress

from headway.edge.transport.lingering import sockets


def lingers(of: socket.socket) -> bool:
    return of.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER) != 0


def connections(port: int) -> list[bool]:
    """Return for each connection through a port, at either end, whether it lingers."""
    found = []
    for of in sockets():
        with suppress(OSError):  # not connected
            is_tcp = of.family in (socket.AF_INET, socket.AF_INET6)
            if is_tcp and port in (of.getsockname()[1], of.getpeername()[1]):
                found.append(lingers(of))
    return found
