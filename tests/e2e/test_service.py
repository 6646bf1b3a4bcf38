"""`headway serve` as its users have it: a process of its own, real zenoh on loopback, signals and probes."""

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from e2e.serving import BLOCK, KEYS, START_S, Service, drive, without_headway
from sim.loopback import session
from sim.until import until

from headway.client import BusFeed
from headway_schemas import Event, Health, RejectedCopy
from headway_schemas.encodings import BSM_MSGPACK
from headway_schemas.handling import Action, Handling, HandlingRequest


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


def test_a_start_that_had_to_compile_is_followed_by_one_without_a_compiler(tmp_path: Path) -> None:
    kernels = tmp_path / "kernels"
    shutil.copytree(os.environ["NUMBA_CACHE_DIR"], kernels)
    for missing in kernels.rglob("reception.pseudonym_changed*"):
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

    def garbage_is_rejected() -> bool:
        car.put(KEYS.bsm("follower"), b"no message", encoding=BSM_MSGPACK, congestion_control=BLOCK)
        return bool(copies)

    until(garbage_is_rejected)
    assert (copies[0].reason, copies[0].sender, copies[0].payload) == ("malformed", "follower", b"no message")

    sent = drive(car, readings=40, fault_from=30)
    until(lambda: events)
    onset = events[0]
    assert (onset.phase, onset.suspect, onset.leader, onset.sensor) == ("onset", "follower", "leader", "location")
    assert onset.innovation.x_m == pytest.approx(20.0, abs=2.0)
    assert onset.deviation.x_m == pytest.approx(20.0, rel=0.05)
    assert onset.onset_us == onset.t_us
    assert onset.evidence is not None

    def scored() -> float:
        records = service.metric("headway_records_total")
        return records["scored"] + records["warming"]

    until(lambda: scored() == sent)
    records = service.metric("headway_records_total")
    [received] = service.metric("headway_messages_total").values()
    assert sum(records.values()) == received == sent + records["malformed"]
    assert service.metric("headway_events_total")[f"{onset.kind} onset"] == 1

    [reply] = list(car.get(KEYS.pairs, timeout=20.0))
    states = {state["follower"]: state for state in json.loads(reply.ok.payload.to_bytes())}
    assert (states["follower"]["leader"], states["leader"].get("leader")) == ("leader", None)
    assert service.stop() == 0


def test_a_vehicle_that_is_muted_on_one_page_is_muted_on_the_others(service: Service) -> None:
    pages = [BusFeed([service.endpoint], [KEYS.site]) for _ in range(2)]
    for page in pages:
        page.start()
    for page in pages:
        until(lambda page=page: any(isinstance(received.message, Health) for received in page.drain()))
    request = HandlingRequest(vehicle="follower", action=Action.MUTE, by="anna", until_us=2**50)
    stored = pages[0].handle(KEYS.site, request)
    assert isinstance(stored, Handling)
    assert stored.model_dump(exclude={"site", "t_us"}) == request.model_dump()
    until(lambda: stored in [received.message for received in pages[1].drain()])
    assert pages[1].handlings([KEYS.site]) == [stored]
    for page in pages:
        page.close()


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
        drive(car, readings=40, fault_from=40)
    until(lambda: reports[-1].scored)
    assert service.stop() == 0
    until(lambda: alive == [True, False])
    [last] = [line for line in service.log() if line["event"] == "stopping"]
    published = reports[-1]
    assert (published.scored, published.warming, published.rejected) == (
        last["scored"],
        last["warming"],
        last["rejected"],
    )
    assert (last["left"], published.queue_depth) == (0, 0)
    assert published.lost == {"shed": 0, "stale": 0, "rate_exceeded": 0}


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
