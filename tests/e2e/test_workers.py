"""`headway serve` with several workers: over real zenoh it publishes what one worker publishes, also after a crash."""

import os
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack
import numpy as np
import pytest
from e2e.serving import BLOCK, KEYS, Service
from sim.loopback import session
from sim.until import until

from headway_schemas import Event
from headway_schemas.encodings import BSM_MSGPACK
from headway_schemas.event import Phase

CELL_M = 600.0
BORDER_DEG = 24_310 * CELL_M / 110_574.0 - 90.0
CARS = 8
MORE = {"HEADWAY_CELL_M": str(CELL_M), "HEADWAY_SNAPSHOT_INTERVAL_S": "0.2"}


@pytest.fixture
def services(tmp_path: Path) -> Iterator[list[Service]]:
    """One service with a single worker and one with two."""
    folders = {n: tmp_path / str(n) for n in (1, 2)}
    started = [Service(of, MORE | state(of) | {"HEADWAY_WORKERS": str(n)}) for n, of in folders.items()]
    yield started
    for service in started:
        service.kill()


def state(folder: Path) -> dict[str, str]:
    return {"HEADWAY_STATE_DIR": str(folder / "state")}


def children(service: Service) -> list[int]:
    """Return the engines' processes."""
    pids = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            parent = int(stat.read_text().rpartition(")")[2].split()[1])
            command = (stat.parent / "cmdline").read_bytes()
        except OSError:
            continue
        if parent == service.process.pid and b"spawn_main" in command:
            pids.append(int(stat.parent.name))
    return pids


def scored(service: Service) -> float:
    return service.metric("headway_records_total")["scored"]


class Road:
    """Cars 25 m apart at the border of two cells, and what each service publishes of them."""

    def __init__(self, services: list[Service], first_m: float = -100.0, speed_mps: float = 20.0) -> None:
        self.sessions = [session("client", connect=(service.endpoint,)) for service in services]
        self.events: list[list[Event]] = [[] for _ in services]
        for bus, events in zip(self.sessions, self.events, strict=True):
            bus.declare_subscriber(
                KEYS.every_alert,
                lambda sample, into=events: into.append(Event.model_validate_json(sample.payload.to_bytes())),
            )
        self.rng = np.random.default_rng(1)
        self.first_m, self.speed_mps = first_m, speed_mps
        self.k, self.start_us = 0, time.time_ns() // 1000

    def drive(self, seconds: float, shift_m: float = 0.0) -> None:
        """Send at 10 Hz; the location of car3 is off by `shift_m`."""
        for _ in range(round(seconds * 10)):
            t_us = time.time_ns() // 1000
            for car in range(CARS):
                x_m = 1e-6 * self.speed_mps * (t_us - self.start_us) - 25.0 * car + self.first_m
                x_m += self.rng.normal(0.0, 0.02) + (shift_m if car == 3 else 0.0)
                v_mps = abs(self.speed_mps + self.rng.normal(0.0, 0.02))
                bsm = {"v": 1, "id": f"car{car}", "msg_cnt": self.k % 128, "t_us": t_us, "lon": -83.0,
                       "lat": BORDER_DEG + x_m / 111_083.0, "speed_mps": v_mps,
                       "heading_deg": 0.0}  # fmt: skip
                for bus in self.sessions:
                    bus.put(KEYS.bsm(bsm["id"]), msgpack.packb(bsm), encoding=BSM_MSGPACK, congestion_control=BLOCK)
            self.k += 1
            time.sleep(0.1)

    def close(self) -> None:
        for bus in self.sessions:
            bus.close()


def onsets(events: list[Event]) -> list[tuple[str, str]]:
    return [(event.event_id, event.suspect) for event in events if event.phase is Phase.ONSET]


def test_two_workers_publish_what_one_does_and_an_event_crosses_the_border(services: list[Service]) -> None:
    road = Road(services)
    try:
        road.drive(8.0)
        road.drive(4.0, shift_m=9.0)  # car3 is over the border after 8.75 s
        road.drive(4.0)
        sent = road.k * CARS
        counted = {"scored", "warming"}
        for service in services:
            until(lambda of=service: sum(of.metric("headway_records_total")[name] for name in counted) == sent, 10.0)
        one, two = services
        assert scored(one) == scored(two)
        until(lambda: any(event.phase is Phase.CLEARED for event in road.events[1]), 10.0)
        assert onsets(road.events[0]) == onsets(road.events[1])
        assert [suspect for _, suspect in onsets(road.events[1])] == ["car3"]
        assert two.metric("headway_handovers_total")[""] == CARS
        assert two.metric("headway_vehicles")[""] == CARS
        assert (len(children(one)), len(children(two))) == (0, 2)
    finally:
        road.close()
    assert [service.stop() for service in services] == [0, 0]


def test_a_worker_that_is_killed_starts_again_with_its_vehicles(tmp_path: Path) -> None:
    patient = {"HEADWAY_MAX_GAP_S": "60", "HEADWAY_MAX_AGE_S": "60", "HEADWAY_QUEUE_AGE_LIMIT_S": "60"}
    service = Service(tmp_path, MORE | patient | state(tmp_path) | {"HEADWAY_WORKERS": "2"})
    road = Road([service], first_m=87.5, speed_mps=0.0)  # four cars stand on each side
    try:
        road.drive(6.0)
        warming = service.metric("headway_records_total")["warming"]
        for pid in children(service):
            os.kill(pid, signal.SIGKILL)
            before = road.k
            road.drive(2.0)
            until(lambda: service.metric("headway_engine_restarts_total")[""] > 0, 20.0)
            assert road.k > before
        until(lambda: service.metric("headway_engine_restarts_total")[""] == 2.0, 20.0)
        road.drive(1.0)
        until(service._is_ready, 10.0)
        records = service.metric("headway_records_total")
        until(lambda: sum(service.metric("headway_records_total").values()) == road.k * CARS, 10.0)
        assert records["warming"] == warming
        assert service.metric("headway_vehicles")[""] == CARS
        assert onsets(road.events[0]) == []
    finally:
        road.close()
    assert service.stop() == 0
