"""Sockets close at once, and nothing else of the process changes."""

import socket
import struct
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest
from edge.transport.connections import connections, lingers
from sim.loopback import free_endpoint, session
from sim.until import until

from headway.edge.transport.lingering import end_lingering

LINGER_10_S = struct.pack("ii", 1, 10)


@pytest.fixture
def connected() -> Iterator[tuple[socket.socket, socket.socket]]:
    """Both ends of a connection, which linger."""
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as stack:
        one = stack.enter_context(socket.create_connection(server.getsockname()))
        other = stack.enter_context(server.accept()[0])
        for of in (one, other):
            of.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, LINGER_10_S)
        yield one, other


def test_no_socket_of_the_process_lingers_and_each_works_on(connected, tmp_path: Path) -> None:
    one, other = connected
    one.setblocking(False)
    with (tmp_path / "file").open("w") as file:
        before = len([*Path("/dev/fd").iterdir()])
        end_lingering()
        assert len([*Path("/dev/fd").iterdir()]) == before
        file.write("still open")
    assert not lingers(one)
    assert not lingers(other)
    assert not one.getblocking()
    one.send(b"x")
    assert other.recv(1) == b"x"


def test_what_is_sent_before_the_end_still_arrives(connected) -> None:
    one, other = connected
    end_lingering()
    one.send(b"last words")
    one.close()
    assert other.recv(100) == b"last words"
    assert other.recv(100) == b""


def test_zenoh_lets_its_connections_linger_or_this_would_not_be_needed() -> None:
    endpoint = free_endpoint()
    port = int(endpoint.rpartition(":")[2])
    with session("peer", listen=(endpoint,)), session("client", connect=(endpoint,)):
        until(lambda: len(connections(port)) == 2)
        assert connections(port) == [True, True]
        end_lingering()
        assert connections(port) == [False, False]
