"""Connections to machines that are gone: to close one must not hold up the others.

zenoh lets its sockets linger for 10 s (SO_LINGER). To close a connection whose last bytes nobody acknowledges then
blocks the thread that reads all others, for so long. Without it the kernel delivers what is left in the background.
"""

import socket
import struct
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Final

_OFF: Final = struct.pack("ii", 0, 0)


def end_lingering() -> None:
    """Let no socket of this process linger when it is closed."""
    for of in sockets():
        with suppress(OSError):  # closed meanwhile
            if of.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER):
                of.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)


def sockets() -> Iterator[socket.socket]:
    """Yield each socket that this process has open, whoever opened it; it stays open."""
    for descriptor in Path("/dev/fd").iterdir():
        try:
            of = socket.socket(fileno=int(descriptor.name))
        except OSError:  # no socket, or closed meanwhile
            continue
        try:
            yield of
        finally:
            of.detach()
