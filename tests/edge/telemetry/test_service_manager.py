"""The datagrams that systemd reads, on a socket of the test."""

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
from sim.clock import FakeClock

from headway.edge.telemetry.service_manager import ServiceManager


@pytest.fixture(params=["path", "abstract"])
def systemd(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[str, socket.socket]]:
    name = str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as receiver:
        receiver.bind(name if request.param == "path" else f"\0{name}")
        receiver.setblocking(False)
        yield name if request.param == "path" else f"@{name}", receiver


def received(receiver: socket.socket) -> list[bytes]:
    found = []
    while True:
        try:
            found.append(receiver.recv(100))
        except BlockingIOError:
            return found


def test_systemd_is_told_each_state_and_life_three_times_within_the_watchdog(
    systemd: tuple[str, socket.socket],
) -> None:
    name, receiver = systemd
    clock = FakeClock()
    manager = ServiceManager(clock, {"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "9000000"})
    for n in range(900):
        manager.tell(is_ready=n >= 400)
        clock.sleep(0.01)
    manager.stopping()
    assert received(receiver) == [b"WATCHDOG=1", b"WATCHDOG=1", b"READY=1", b"WATCHDOG=1", b"STOPPING=1"]


def test_without_a_watchdog_no_life_is_told(systemd: tuple[str, socket.socket]) -> None:
    name, receiver = systemd
    manager = ServiceManager(FakeClock(), {"NOTIFY_SOCKET": name})
    manager.tell(is_ready=False)
    assert received(receiver) == []


@pytest.mark.parametrize("environment", [{}, {"NOTIFY_SOCKET": "/absent/notify", "WATCHDOG_USEC": "1"}])
def test_without_systemd_nothing_is_sent_and_nothing_fails(environment: dict[str, str]) -> None:
    manager = ServiceManager(FakeClock(), environment)
    manager.tell(is_ready=True)
    manager.stopping()
