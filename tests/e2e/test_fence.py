"""Two services of one site in a fleet: the older one publishes nothing after the newer one has begun."""

import signal
from pathlib import Path

import pytest
import zenoh
from e2e.serving import KEYS, Service, drive
from sim.loopback import free_endpoint, session
from sim.until import until

from headway.edge.fence import LEASE_EXPIRED, REPLACED, SupersededError
from headway_schemas import Event


class Site:
    """A router, the services of a site one after the other, and the epochs of the alerts in the order received."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._endpoint = free_endpoint()
        self.router = session("router", listen=(self._endpoint,))
        self.car = session("client", connect=(self._endpoint,))
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

    def start(self, epoch: int) -> Service:
        settings = {
            "HEADWAY_EPOCH": str(epoch),
            "HEADWAY_STATE_DIR": str(self._folder / "state"),
            "HEADWAY_MODE": "client",
            "HEADWAY_CONNECT": self._endpoint,
        }
        self.services.append(Service(self._folder / str(epoch), settings))
        return self.services[-1]

    def drive_until_published_by(self, epoch: int) -> None:
        drive(self.car, readings=60, fault_from=40)
        until(lambda: epoch in self.epochs)


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


def test_an_older_service_ends_and_the_newer_one_knows_its_vehicles(site: Site) -> None:
    older = site.start(1)
    site.drive_until_published_by(1)
    newer = site.start(2)
    assert_ended(older, REPLACED)
    site.drive_until_published_by(2)
    assert site.epochs == sorted(site.epochs)
    assert site.held == [KEYS.epoch(epoch, "i") for epoch in (1, 2)]
    assert newer.said("snapshot")
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
