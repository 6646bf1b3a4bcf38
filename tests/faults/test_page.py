"""Visitors of the page that send or read slowly: others are served, and the slow ones are closed in time."""

import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from urllib.parse import urlsplit

import httpx
import pytest
from browser.serving import dashboard
from e2e.serving import KEYS
from faults.harness.processes import Fleet
from sim.until import until

from headway.dashboard.server import HEADERS_S, STALL_S

SLOW = 200
SERVED_S = 1.0


@contextmanager
def slow(page: str, request: bytes) -> Iterator[list[socket.socket]]:
    """Connect many times, send a request or a part of one, and read nothing."""
    place = urlsplit(page)
    sockets = []
    for _ in range(SLOW):
        one = socket.socket()
        one.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
        one.connect((place.hostname, place.port))
        one.sendall(request)
        sockets.append(one)
    yield sockets
    for one in sockets:
        one.close()


REQUESTS = {
    "slow headers": (b"GET / HTTP/1.1\r\nX: ", HEADERS_S + 5.0),
    "slow readers of the stream": (b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n", STALL_S + 25.0),
}


@pytest.mark.parametrize("kind", REQUESTS)
def test_others_are_served(start, measured, kind: str) -> None:
    request, closed_s = REQUESTS[kind]
    service = start()
    with (
        dashboard([service.endpoint], [KEYS.site]) as page,
        slow(page, request) as sockets,
        Fleet(service.endpoint, KEYS.site, cars=200, seconds=closed_s + 5.0),
    ):
        begun_s = time.monotonic()
        assert httpx.get(page, timeout=SERVED_S).status_code == 200
        took_s = time.monotonic() - begun_s
        until(lambda: streams(page), closed_s)
        stream_s = time.monotonic() - begun_s
        until(lambda: all(map(is_closed, sockets)), closed_s)
    got = f"page in {took_s:.2f} s, a stream in {stream_s:.1f} s, all closed"
    measured(f"page: {SLOW} {kind}", got, f"page <= {SERVED_S:.0f} s, closed in {closed_s:.0f} s")


def streams(page: str) -> bool:
    """Whether a visitor gets a stream now."""
    with httpx.stream("GET", f"{page}/stream", timeout=5.0) as answer:
        return answer.status_code == 200 and next(answer.iter_lines()) is not None


def is_closed(one: socket.socket) -> bool:
    """Whether the server has closed a connection, whatever was sent before."""
    one.setblocking(False)
    try:
        while one.recv(1 << 16):
            pass
    except BlockingIOError:
        return False
    except OSError:
        return True
    return True
