"""A zenoh router with a configuration file of `deploy/zenoh`, listening on an endpoint, in a process of its own.

Where it is deployed the kernel gives up connections after `net.ipv4.tcp_retries2` = 3 retransmissions, 3 s. A test must
not change the machine, so here each socket has the same as an option of its own.
"""

import json
import socket
import sys
from contextlib import suppress

import zenoh

from headway.edge.transport.lingering import sockets

GIVE_UP_MS = 3_000


def give_up_soon(_event: object) -> None:
    """Set TCP_USER_TIMEOUT of each connection."""
    for of in sockets():
        with suppress(OSError):  # no connection
            of.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, GIVE_UP_MS)


def main() -> None:
    endpoint, file = sys.argv[1:]
    config = zenoh.Config.from_file(file)
    config.insert_json5("listen/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session, session.info.declare_link_events_listener(give_up_soon, history=True):
        print("ready", flush=True)
        sys.stdin.read()  # until the parent closes it


if __name__ == "__main__":
    main()
