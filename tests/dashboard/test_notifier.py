"""Notices reach receivers over HTTP, once each, in order, and again where a receiver failed."""

import asyncio
import json
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

import pytest
from fake_service import event
from sim.until import until

from headway.client import SiteMessage
from headway.dashboard import notifier
from headway.dashboard.broadcast import wall_us
from headway.dashboard.notifier import Notifier, Receivers
from headway.dashboard.view_state import ViewState
from headway.errors import UserError
from headway_schemas import Phase


class Receiver(ThreadingHTTPServer):
    """Keeps what is posted, and answers with the next of its statuses, then with 200."""

    def __init__(self) -> None:
        self.posted: list[tuple[str, Any]] = []
        self.statuses: list[int] = []
        super().__init__(("127.0.0.1", 0), _Handler)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.server_port}"


class _Handler(BaseHTTPRequestHandler):
    server: Receiver

    def do_POST(self) -> None:
        body = json.loads(self.rfile.read(int(self.headers["Content-Length"])))
        status = self.server.statuses.pop(0) if self.server.statuses else 200
        self.server.posted.append((self.path, body))
        self.send_response(status)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with Receiver() as server:
        thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
        thread.start()
        yield server
        server.shutdown()
        thread.join()


def notified(receivers: Receivers, receiver: Receiver, posts: int) -> None:
    """Let a vehicle be faulty and then not, until so many requests came."""

    async def scenario() -> None:
        view_state = ViewState()
        running = asyncio.create_task(Notifier(receivers, view_state, wall_us).run())
        view_state.apply(SiteMessage("local", event(1, t_us=wall_us())), 1)
        await asyncio.to_thread(until, lambda: len(receiver.posted) >= posts // 2)
        view_state.apply(SiteMessage("local", event(1, Phase.CLEARED, t_us=wall_us())), 2)
        await asyncio.to_thread(until, lambda: len(receiver.posted) >= posts)
        await asyncio.sleep(0.1)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(asyncio.wait_for(scenario(), 30))


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(notifier, "_EVERY_S", 0.02)
    monkeypatch.setattr(notifier, "_RETRY_S", (0.01, 0.01))
    monkeypatch.setattr("headway.dashboard.notices.QUIET_US", 50_000)


def test_a_webhook_gets_one_post_at_the_onset_and_one_at_the_end(receiver: Receiver) -> None:
    notified(Receivers(webhook=f"{receiver.address}/hook"), receiver, 2)
    assert [(path, body["status"]) for path, body in receiver.posted] == [("/hook", "firing"), ("/hook", "resolved")]


def test_alertmanager_gets_the_same_alert_twice(receiver: Receiver) -> None:
    notified(Receivers(alertmanager=f"{receiver.address}/"), receiver, 2)
    assert {path for path, _ in receiver.posted} == {"/api/v2/alerts"}
    (first,), (last,) = (body for _, body in receiver.posted)
    assert first["labels"] == last["labels"]


def test_a_failure_is_tried_again_and_a_refusal_is_not(receiver: Receiver, capsys: pytest.CaptureFixture[str]) -> None:
    receiver.statuses = [503, 200, 400]
    notified(Receivers(webhook=receiver.address), receiver, 3)
    assert [body["status"] for _, body in receiver.posted] == ["firing", "firing", "resolved"]
    assert "a notice is not delivered: status 400" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["file:///etc/passwd", "127.0.0.1:9093", "http://"])
def test_an_address_that_is_none_is_one_line(address: str) -> None:
    with pytest.raises(UserError, match="no address of HTTP"):
        Receivers(alertmanager=address)
