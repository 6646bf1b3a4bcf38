"""What operators and visitors do: stop under load, a second service, a folder that cannot be written, slow readers."""

import socket
import subprocess
import sys
import time
from pathlib import Path
from urllib.parse import urlsplit

import httpx
import pytest
from e2e.serving import KEYS, without_headway
from faults.harness.processes import Fleet, Subscriber
from sim.loopback import free_endpoint
from sim.until import until

STOP_S, READERS = 12.0, 200


def test_stopped_under_load(start, router, measured) -> None:
    service = start(router)
    with Fleet(router.endpoint, KEYS.site, cars=300, seconds=8.0) as fleet:
        time.sleep(6.0)
        begun_s = time.monotonic()
        status = service.stop()
        took_s = time.monotonic() - begun_s
        fleet.sent()
    [end] = service.said("stopping")
    measured("SIGTERM under load, 300 cars", f"status {status} in {took_s:.1f} s, {end['left']} left", "0, 0 left")
    assert (status, end["left"]) == (0, 0)
    assert took_s <= STOP_S


def test_a_second_service_on_one_folder(start, measured, tmp_path: Path) -> None:
    service = start()
    more = {"HEADWAY_SITE": KEYS.site, "HEADWAY_INSTANCE": "i", "HEADWAY_LISTEN": free_endpoint()}
    more |= {"HEADWAY_HTTP_PORT": "0", "HEADWAY_STATE_DIR": str(tmp_path / "state"), "HEADWAY_VEHICLE_CAPACITY": "1000"}
    second = subprocess.run(
        [sys.executable, "-m", "headway", "serve"], env=without_headway() | more, capture_output=True, timeout=300.0,
        check=False, text=True,
    )  # fmt: skip
    last = second.stderr.strip().splitlines()[-1]
    measured("two services on one folder", f"status {second.returncode}: {last[:60]}", "refused, one line")
    assert second.returncode == 2
    assert "another service of this site and instance" in last
    assert service.metric("headway_ready")[""] == 1


def test_two_services_of_one_site(start, router, measured, tmp_path: Path) -> None:
    first = start(router, instance="first", state_dir=str(tmp_path / "first"))
    second = start(router, instance="second", state_dir=str(tmp_path / "second"))
    until(lambda: first.said("another service judges this site") and second.said("another service judges this site"))
    time.sleep(2.0)
    lines_of = [service.said("another service judges this site") for service in (first, second)]
    others = [service.metric("headway_other_services")[""] for service in (first, second)]
    got = f"each names the other: {[line['other'] for lines in lines_of for line in lines]}"
    measured("two services of one site", got, "stated, a line each")
    assert [[line["other"] for line in lines] for lines in lines_of] == [["second"], ["first"]]
    assert others == [1, 1]


def test_a_folder_that_cannot_be_written(start, measured, tmp_path: Path) -> None:
    folder = tmp_path / "state"
    folder.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "ro,size=1m", "tmpfs", folder], check=False).returncode:
        pytest.skip("may not mount a file system")
    try:
        service = start()
        with (
            Subscriber(service.endpoint, KEYS.site) as bus,
            Fleet(service.endpoint, KEYS.site, cars=4, seconds=10.0, faulty=1) as fleet,
        ):
            fleet.sent()
            until(lambda: bus.alerts)
        logged = [line["event"] for line in service.log() if line["level"] == "error"]
        service.kill()
    finally:
        subprocess.run(["umount", "--lazy", folder], check=True)
    measured("read-only folder", f"alerts go out, logged: {sorted(set(logged))}"[:90], "a line each")
    assert sorted(logged) == sorted(set(logged))
    assert any(event.startswith("journal fails") for event in logged)


def test_a_burst_of_ten_times_the_rate(start, measured) -> None:
    service = start(vehicle_capacity="2000")
    with Fleet(service.endpoint, KEYS.site, cars=60, seconds=15.0) as fleet:
        time.sleep(5.0)
        with Fleet(service.endpoint, KEYS.site, cars=540, seconds=4.0, prefix="burst") as burst:
            sent = sum(fleet.sent().values()) + sum(burst.sent().values())
        until(lambda: sum(service.metric("headway_records_total").values()) >= sent)
    accounted = sum(service.metric("headway_records_total").values())
    measured("burst of ten times the rate", f"{service.judged() / sent:.3f} judged of {sent}", "all accounted for")
    assert accounted == sent


def test_slow_readers_of_the_metrics_port(start, measured) -> None:
    service = start()
    address = ("127.0.0.1", urlsplit(service.url).port)
    slow = [socket.create_connection(address) for _ in range(READERS)]
    for one in slow:
        one.sendall(b"GET /metrics HTTP/1.1\r\nX: ")
    with Fleet(service.endpoint, KEYS.site, cars=20, seconds=5.0) as fleet:
        begun_s = time.monotonic()
        assert httpx.get(f"{service.url}/readyz").status_code == 200
        took_s = time.monotonic() - begun_s
        sent = sum(fleet.sent().values())
    until(lambda: service.judged() >= sent)
    for one in slow:
        one.close()
    measured(f"{READERS} slow readers of the metrics port", f"/readyz after {took_s:.2f} s, all judged", "goes on")
