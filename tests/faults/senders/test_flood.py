"""One sender that floods the service: the others are judged, and what they do wrong is found."""

import threading
import time
from pathlib import Path

import pytest
from e2e.serving import KEYS
from faults.harness.processes import Fleet, Flood, Subscriber
from sim.until import until

CARS, SECONDS = 60, 20.0
JUDGED_MIN, RSS_MAX_MB = 0.95, 1_000.0


def test_one_sender_at_full_speed(start, measured) -> None:
    service = start(sender_rate_hz="100")
    with (
        Subscriber(service.endpoint, KEYS.site) as bus,
        Fleet(service.endpoint, KEYS.site, cars=CARS, seconds=SECONDS, faulty=1, fault_s=12.0) as fleet,
    ):
        time.sleep(5.0)
        with Flood(service.endpoint, KEYS.site, seconds=SECONDS - 5.0) as flood:
            sent, flooded = sum(fleet.sent().values()), flood.sent()
        time.sleep(2.0)
        outcomes = service.metric("headway_records_total")
        found = any(a["suspect"] == f"car-{CARS - 1}" for a in bus.alerts)
    honest, refused = service.judged() / sent, outcomes["rate_exceeded"]
    got = f"{honest:.3f} judged, found: {found}; {flooded / 15.0:.0f} a second, {refused:.0f} rate_exceeded"
    measured("flood by one sender", got, ">= .95 of the honest, found")
    assert honest >= JUDGED_MIN
    assert found


@pytest.mark.parametrize("megabytes", [16])
def test_large_payloads(start, measured, megabytes: int) -> None:
    service, most_mb, over = start(sender_rate_hz="100"), [0.0], threading.Event()

    def watch() -> None:
        while not over.wait(0.1):
            most_mb[0] = max(most_mb[0], _rss_mb(service.process.pid))

    watching = threading.Thread(target=watch)
    watching.start()
    with Flood(service.endpoint, KEYS.site, seconds=15.0, payload_bytes=megabytes * 1_000_000) as flood:
        sent = flood.sent()
    until(lambda: service.metric("headway_ready")[""] == 1)
    over.set()
    watching.join()
    named = sum(service.metric("headway_records_total").values())
    measured(f"{megabytes} MB payloads", f"RSS {most_mb[0]:.0f} MB; {sent} sent, {named:.0f} named", "< 1 GB")
    assert most_mb[0] < RSS_MAX_MB


def _rss_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text(encoding="ascii").splitlines()
    return next(float(line.split()[1]) / 1e3 for line in lines if line.startswith("VmRSS"))
