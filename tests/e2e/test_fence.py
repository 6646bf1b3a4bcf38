"""Two services of one site in a fleet: the older one publishes nothing after the newer one has begun."""

import signal
import time
from pathlib import Path

import pytest
import zenoh
from e2e.serving import KEYS, Service, drive
from faults.harness.processes import Fleet
from sim.loopback import free_endpoint, session
from sim.until import until

from headway.edge.fence import LEASE_EXPIRED, REPLACED, SupersededError
from headway.settings import Settings
from headway_schemas import Event

CARS = 6
ATTEMPTS, DRIVE_S = 5, 7.0
"""A drive is of 6 s of event time, and none begins before the end of the last one."""
WARMING_READINGS = Settings().warming_readings


class Site:
    """A router, the services of a site one after the other, and the epochs of the alerts in the order received."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.endpoint = free_endpoint()
        self.router = session("router", listen=(self.endpoint,))
        self.car = session("client", connect=(self.endpoint,))
        self.services: list[Service] = []
        self.epochs: list[int | None] = []
        self.held: list[str] = []
        self.router.declare_subscriber(KEYS.every_alert, self._receive)
        self.router.liveliness().declare_subscriber(KEYS.every_epoch, self._watch)

    def _receive(self, sample: zenoh.Sample) -> None:
        self.epochs.append(Event.model_validate_json(sample.payload.to_bytes()).epoch)

    def _watch(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            self.held.append(str(sample.key_expr))

    def start(self, epoch: int, workers: int = 1) -> Service:
        settings = {
            "HEADWAY_WORKERS": str(workers),
            "HEADWAY_EPOCH": str(epoch),
            "HEADWAY_LEASE_S": "4",  # the machine may be busy
            "HEADWAY_STATE_DIR": str(self._folder / "state"),
            "HEADWAY_MODE": "client",
            "HEADWAY_CONNECT": self.endpoint,
        }
        self.services.append(Service(self._folder / str(epoch), settings))
        return self.services[-1]

    def drive_until_published_by(self, epoch: int) -> None:
        """Drive, and again where a busy machine let messages become too old."""
        for _ in range(ATTEMPTS):
            drive(self.car, readings=60, fault_from=40)
            give_up_s = time.monotonic() + DRIVE_S
            while epoch not in self.epochs and time.monotonic() < give_up_s:
                time.sleep(0.01)
            if epoch in self.epochs:
                return
        raise AssertionError(f"no alert of epoch {epoch}")


@pytest.fixture
def site(tmp_path: Path):
    site = Site(tmp_path)
    yield site
    for service in site.services:
        service.kill()
    for opened in (site.car, site.router):
        opened.close()


def assert_ended(service: Service, *reasons: str) -> None:
    assert service.process.wait(30.0) == SupersededError.status
    assert service.said("no longer the publisher")[0]["reason"] in reasons


@pytest.mark.parametrize("workers", [1, 2])
def test_an_older_service_ends_and_the_newer_one_knows_its_vehicles(site: Site, workers: int) -> None:
    older = site.start(1, workers)
    site.drive_until_published_by(1)
    newer = site.start(2, workers)
    assert_ended(older, REPLACED)
    site.drive_until_published_by(2)
    assert site.epochs == sorted(site.epochs)
    assert site.held == [KEYS.epoch(epoch, "i") for epoch in (1, 2)]
    assert newer.said("snapshot")
    assert newer.stop() == 0


def test_each_record_is_judged_by_one_of_the_two(site: Site) -> None:
    older = site.start(1)
    with Fleet(site.endpoint, KEYS.site, cars=CARS, seconds=8.0) as fleet:
        until(lambda: older.judged() > 0)
        newer = site.start(2)
        assert_ended(older, REPLACED)
        sent = sum(fleet.sent().values())
    [last] = older.said("stopping")
    until(lambda: last["scored"] + last["warming"] + newer.judged() == sent)
    assert newer.metric("headway_sequence_gap_messages_total")[""] == 0
    assert newer.metric("headway_records_total")["warming"] + last["warming"] <= CARS * WARMING_READINGS
    assert newer.stop() == 0


def test_a_service_that_hung_publishes_nothing_when_it_continues(site: Site) -> None:
    older = site.start(1)
    site.drive_until_published_by(1)
    older.process.send_signal(signal.SIGSTOP)
    site.start(2)
    site.drive_until_published_by(2)
    older.process.send_signal(signal.SIGCONT)
    assert_ended(older, LEASE_EXPIRED, REPLACED)
    site.drive_until_published_by(2)
    assert site.epochs == sorted(site.epochs)
