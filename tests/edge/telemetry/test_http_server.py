"""The probes: 200 when nothing is wrong, 503 with its words when something is."""

import socket
from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from sim.until import until

from headway.edge.telemetry import http_server
from headway.edge.telemetry.http_server import HttpServer


class Patient:
    liveness_problem: str | None = None
    readiness_problem: str | None = "kernels are being compiled"


@pytest.fixture
def patient() -> Patient:
    return Patient()


@pytest.fixture
def url(patient: Patient) -> Iterator[str]:
    with HttpServer(
        "127.0.0.1",
        0,
        metrics=lambda: b"headway_ready 0\n",
        content_type="text/plain; version=0.0.4",
        liveness_problem=lambda: patient.liveness_problem,
        readiness_problem=lambda: patient.readiness_problem,
    ) as server:
        yield f"http://127.0.0.1:{server.port}"


def test_probes_tell_what_is_wrong_until_it_is_not(url: str, patient: Patient) -> None:
    assert (httpx.get(f"{url}/livez").status_code, httpx.get(f"{url}/livez").text) == (200, "ok\n")
    starting = httpx.get(f"{url}/readyz")
    assert (starting.status_code, starting.text) == (503, "kernels are being compiled\n")
    patient.readiness_problem = None
    patient.liveness_problem = "no loop iteration for 3.0 s"
    assert httpx.get(f"{url}/readyz").status_code == 200
    assert httpx.get(f"{url}/livez").status_code == 503


def test_metrics_have_their_content_type(url: str) -> None:
    answer = httpx.get(f"{url}/metrics")
    assert (answer.text, answer.headers["content-type"]) == ("headway_ready 0\n", "text/plain; version=0.0.4")


def test_another_page_is_not_found(url: str) -> None:
    assert httpx.get(f"{url}/").status_code == 404


def test_the_address_is_given_back() -> None:
    def server(port: int) -> HttpServer:
        return HttpServer(
            "127.0.0.1",
            port,
            metrics=bytes,
            content_type="",
            liveness_problem=lambda: None,
            readiness_problem=lambda: None,
        )

    with server(0) as first:
        port = first.port
        with pytest.raises(OSError):
            server(port)
    with server(port) as again:
        assert again.port == port


def test_a_client_that_never_ends_its_request_is_closed_and_holds_up_nobody(url: str, monkeypatch) -> None:
    monkeypatch.setattr(http_server, "CONNECTION_S", 0.5)
    with socket.create_connection(("127.0.0.1", urlsplit(url).port)) as slow:
        slow.settimeout(10.0)
        slow.sendall(b"GET /metrics HTTP/1.1\r\nX: ")
        assert httpx.get(f"{url}/livez").status_code == 200

        def closed() -> bool:
            try:
                slow.sendall(b"x")
            except OSError:
                return True
            return False

        until(closed)


def test_connections_are_bounded_and_come_back(url: str, monkeypatch) -> None:
    monkeypatch.setattr(http_server, "CONNECTION_S", 1.0)
    address = ("127.0.0.1", urlsplit(url).port)
    slow = [socket.create_connection(address) for _ in range(http_server.CONNECTIONS_MAX)]

    def answered() -> bool:
        try:
            return httpx.get(f"{url}/livez").status_code == 200
        except httpx.TransportError:
            return False

    until(lambda: not answered() or slow[0].recv(1) == b"")
    until(answered)
    for one in slow:
        one.close()
