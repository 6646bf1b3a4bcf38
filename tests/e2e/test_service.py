"""`headway serve` as its users have it: a process of its own, real zenoh on loopback, signals and probes."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import msgpack
import pytest
import zenoh
from prometheus_client.parser import text_string_to_metric_families
from sim.loopback import free_endpoint, session
from sim.until import until

from headway_schemas import Event, Health, Keys, RejectedCopy
from headway_schemas.encodings import BSM_MSGPACK

KEYS = Keys("v2x", "e2e")
START_S = 120.0
"""The first start on a machine compiles the kernels."""
BLOCK = zenoh.CongestionControl.BLOCK


class Service:
    """The process and how to look at it from outside."""

    def __init__(self, folder: Path, more: dict[str, str] | None = None) -> None:
        self.endpoint = free_endpoint()
        self._log = folder / "log"
        settings = {
            "HEADWAY_SITE": KEYS.site,
            "HEADWAY_INSTANCE": "i",
            "HEADWAY_LISTEN": self.endpoint,
            "HEADWAY_HTTP_PORT": "0",
            "HEADWAY_VEHICLE_CAPACITY": "64",
            "HEADWAY_HEALTH_INTERVAL_S": "0.1",
        }
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "headway", "serve"], env=without_headway() | settings | (more or {}), stderr=log
            )
        until(self._is_ready, START_S)

    def _is_ready(self) -> bool:
        """Whether it is, where it last said that it is to be asked: a start that compiles is followed by another."""
        ports = [line["http_port"] for line in self.log() if "http_port" in line]
        assert self.process.poll() is None, self._log.read_text(encoding="utf-8")
        if not ports:
            return False
        self.url = f"http://127.0.0.1:{ports[-1]}"
        try:
            return httpx.get(f"{self.url}/readyz").status_code == 200
        except httpx.TransportError:
            return False

    def log(self) -> list[dict]:
        return [json.loads(line) for line in self._log.read_text(encoding="utf-8").splitlines()]

    def metric(self, name: str) -> dict[str, float]:
        """Values by the labels' values, joined."""
        families = text_string_to_metric_families(httpx.get(f"{self.url}/metrics").text)
        return {
            " ".join(sample.labels.values()): sample.value
            for family in families
            for sample in family.samples
            if sample.name == name
        }

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(30.0)


def without_headway() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.upper().startswith("HEADWAY_")}


@pytest.fixture
def service(tmp_path: Path) -> Iterator[Service]:
    service = Service(tmp_path)
    yield service
    service.process.kill()
    service.process.wait(10.0)


@pytest.fixture
def car(service: Service) -> Iterator[zenoh.Session]:
    sender = session("client", connect=(service.endpoint,))
    yield sender
    sender.close()


def drive(sender: zenoh.Session, readings: int, lie_from: int) -> int:
    """Send the last seconds of a leader and of a follower whose location lies by 20 m from some reading on; 10 Hz."""
    end_us = time.time_ns() // 1000
    for k in range(readings):
        t_us = end_us - (readings - 1 - k) * 100_000
        for name, behind_m in (("leader", 0.0), ("follower", 30.0)):
            lie_m = 20.0 if name == "follower" and k >= lie_from else 0.0
            lat = 42.0 + (1.5 * k - behind_m + lie_m) / 111_083.0
            record = [1, name, k % 128, t_us, lat, -83.0, 15.0, 0.0, None, None, None, 4.5]
            sender.put(KEYS.bsm(name), msgpack.packb(record), encoding=BSM_MSGPACK, congestion_control=BLOCK)
    return 2 * readings


def test_a_start_that_had_to_compile_is_followed_by_one_without_a_compiler(tmp_path: Path) -> None:
    kernels = tmp_path / "kernels"
    shutil.copytree(os.environ["NUMBA_CACHE_DIR"], kernels)
    for missing in kernels.rglob("silence.renamed*"):
        missing.unlink()
    service = Service(tmp_path, {"NUMBA_CACHE_DIR": str(kernels)})
    said = [line["event"] for line in service.log()]
    assert (said.count("starting"), said.count("starting anew"), said.count("ready")) == (2, 1, 1)
    assert service.stop() == 0


def test_a_lie_becomes_an_alert_and_every_message_is_accounted_for(service: Service, car: zenoh.Session) -> None:
    events: list[Event] = []
    copies: list[RejectedCopy] = []
    car.declare_subscriber(
        KEYS.every_alert, lambda sample: events.append(Event.model_validate_json(sample.payload.to_bytes()))
    )
    car.declare_subscriber(
        KEYS.every_rejected, lambda sample: copies.append(RejectedCopy.model_validate_json(sample.payload.to_bytes()))
    )

    def garbage_is_told_back() -> bool:
        car.put(KEYS.bsm("follower"), b"no message", encoding=BSM_MSGPACK, congestion_control=BLOCK)
        return bool(copies)

    until(garbage_is_told_back)
    assert (copies[0].reason, copies[0].sender, copies[0].payload) == ("malformed", "follower", b"no message")

    sent = drive(car, readings=40, lie_from=30)
    until(lambda: events)
    onset = events[0]
    assert (onset.phase, onset.suspect, onset.leader, onset.sensor) == ("onset", "follower", "leader", "location")
    assert onset.innovation.x_m == pytest.approx(20.0, abs=2.0)
    assert onset.evidence is not None

    def judged() -> float:
        records = service.metric("headway_records_total")
        return records["scored"] + records["warming"]

    until(lambda: judged() == sent)
    records = service.metric("headway_records_total")
    [received] = service.metric("headway_messages_total").values()
    assert sum(records.values()) == received == sent + records["malformed"]
    assert service.metric("headway_events_total")[f"{onset.kind} onset"] == 1

    [reply] = list(car.get(KEYS.pairs, timeout=20.0))
    states = {state["follower"]: state for state in json.loads(reply.ok.payload.to_bytes())}
    assert (states["follower"]["leader"], states["leader"].get("leader")) == ("leader", None)
    assert service.stop() == 0


def test_on_sigterm_what_is_queued_is_judged_and_the_last_report_is_told(service: Service, car: zenoh.Session) -> None:
    reports: list[Health] = []
    alive: list[bool] = []
    car.declare_subscriber(
        KEYS.every_health, lambda sample: reports.append(Health.model_validate_json(sample.payload.to_bytes()))
    )
    car.liveliness().declare_subscriber(
        KEYS.every_liveliness, lambda sample: alive.append(sample.kind == zenoh.SampleKind.PUT), history=True
    )
    until(lambda: reports and alive)
    for _ in range(50):
        drive(car, readings=40, lie_from=40)
    until(lambda: reports[-1].scored)
    assert service.stop() == 0
    until(lambda: alive == [True, False])
    [last] = [line for line in service.log() if line["event"] == "stopping"]
    told = reports[-1]
    assert (told.scored, told.warming, told.rejected) == (last["scored"], last["warming"], last["rejected"])
    assert (last["left"], told.queue_depth) == (0, 0)
    assert told.lost == {"shed": 0, "stale": 0}


def test_an_address_that_is_taken_ends_with_status_2_and_one_line(service: Service) -> None:
    settings = {"HEADWAY_LISTEN": service.endpoint, "HEADWAY_HTTP_PORT": "0"}
    second = subprocess.run(
        [sys.executable, "-m", "headway", "serve"],
        env=without_headway() | settings | {"HEADWAY_LOG_LEVEL": "error"},
        capture_output=True,
        text=True,
        check=False,
        timeout=START_S,
    )
    assert (second.returncode, second.stdout, second.stderr.count("\n")) == (2, "", 1)
    assert second.stderr.startswith("headway: zenoh: ")
