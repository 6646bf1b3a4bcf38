"""Connections to machines that are gone: to close one must not hold up the others.

zenoh lets its sockets linger for 10 s (SO_LINGER). To close a connection whose last bytes nobody acknowledges then
blocks the thread that reads all others, for so long. Without it the kernel delivers what is left in the background.
"""

import os
import socket
import struct
from contextlib import suppress
from pathlib import Path
from typing import Final

_OFF: Final = struct.pack("ii", 0, 0)


def end_lingering() -> None:
    """Let no socket of this process linger when it is closed."""
    for descriptor in Path("/dev/fd").iterdir():
        with suppress(OSError):  # no socket, or closed meanwhile
            _end_lingering(os.dup(int(descriptor.name)))


def _end_lingering(copy: int) -> None:
    """Change the socket of a descriptor, which is closed: the socket has another one."""
    try:
        of = socket.socket(fileno=copy)
    except OSError:
        os.close(copy)
        raise
    with of:
        if of.getsockopt(socket.SOL_SOCKET, socket.SO_LINGER):
            of.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _OFF)
