import socket
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import httpx
import pytest
from fake_service import START_US, FakeFeed, Traffic

from headway.client import History
from headway.dashboard import server as page
from headway.dashboard.broadcast import Broadcaster
from headway.dashboard.server import STALL_S, Server, bind, serve
from headway.errors import UserError


class BusyFeed(FakeFeed):
    """Every turn brings 2,000 new states: 200 kB a frame."""

    def drain(self) -> Iterator:
        self.deliver(*STATES)
        return super().drain()


STATES = list(Traffic(2_000).states(0.0, START_US))


@contextmanager
def serving(feed: FakeFeed, stall_s: float = STALL_S) -> Iterator[tuple[int, Broadcaster]]:
    with bind("127.0.0.1", 0, stall_s) as listener:
        server = Server(feed, ["local"], "127.0.0.1", None, ())
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        thread.start()
        yield listener.getsockname()[1], server.broadcaster
        server.should_exit = True
        thread.join(20)
        assert not thread.is_alive()


def until(done: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not done():
        assert time.monotonic() < deadline
        time.sleep(0.02)


@contextmanager
def stalled_browser(port: int) -> Iterator[None]:
    with socket.socket() as stalled:
        stalled.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        stalled.connect(("127.0.0.1", port))
        stalled.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
        yield


def test_a_browser_that_takes_nothing_does_not_slow_another() -> None:
    with serving(BusyFeed()) as (port, _), stalled_browser(port):
        frames = 0
        with httpx.stream("GET", f"http://127.0.0.1:{port}/stream", timeout=20) as answer:
            for line in answer.iter_lines():
                frames += line.startswith("data:")
                if frames == 10:
                    break
    assert frames == 10


@pytest.mark.skipif(sys.platform != "linux", reason="the kernel's user timeout is Linux's")
def test_a_browser_that_takes_nothing_is_dropped() -> None:
    with serving(BusyFeed(), stall_s=0.3) as (port, broadcaster), stalled_browser(port):
        until(lambda: broadcaster.viewers == 1)
        until(lambda: broadcaster.viewers == 0)


def test_a_browser_that_never_ends_its_request_is_closed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "HEADERS_S", 0.3)
    with serving(FakeFeed()) as (port, _), socket.create_connection(("127.0.0.1", port)) as slow:
        slow.settimeout(10.0)
        slow.sendall(b"GET / HTTP/1.1\r\nX: ")
        assert slow.recv(1) == b""


def test_a_stream_outlives_the_time_for_headers(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page, "HEADERS_S", 0.3)
    with serving(FakeFeed()) as (port, _), httpx.stream("GET", f"http://127.0.0.1:{port}/stream") as stream:
        lines = stream.iter_lines()
        assert sum(line.startswith("data:") for line, _ in zip(lines, range(30), strict=False)) >= 5


def test_the_end_lets_every_viewer_go() -> None:
    feed = FakeFeed()
    with serving(feed) as (port, _):
        reader = httpx.stream("GET", f"http://127.0.0.1:{port}/stream", timeout=20)
        lines = reader.__enter__().iter_lines()
        next(lines)
    assert any(line.startswith("data:") for line in lines)
    reader.__exit__(None, None, None)
    assert feed.closed


def test_a_request_that_goes_on_at_the_end_writes_no_error(capfd: pytest.CaptureFixture[str]) -> None:
    asked, ended = threading.Event(), threading.Event()

    class SlowFeed(FakeFeed):
        def history(self, *_: object) -> History:
            asked.set()
            ended.wait(10.0)
            return History([], answers=1)

    with serving(SlowFeed()) as (port, _), socket.create_connection(("127.0.0.1", port)) as waiting:
        waiting.sendall(b"GET /history HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert asked.wait(10.0)
        threading.Timer(3.0, ended.set).start()
    assert capfd.readouterr().err == ""


def test_a_bug_stops_the_server_and_shows() -> None:
    class Broken(FakeFeed):
        def drain(self) -> Iterator:
            raise ZeroDivisionError

    with socket.create_server(("127.0.0.1", 0)) as listener:
        server = Server(Broken(), ["local"], "127.0.0.1", None, ())
        with pytest.raises(ExceptionGroup, match="unhandled errors"):
            server.run(sockets=[listener])


def test_a_taken_port_is_one_line() -> None:
    with socket.create_server(("127.0.0.1", 0)) as other:
        port = other.getsockname()[1]
        with pytest.raises(UserError, match=f"cannot listen on 127.0.0.1 port {port}: Address already in use"):
            serve(port=port)
