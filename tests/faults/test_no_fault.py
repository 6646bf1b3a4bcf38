"""The harness itself: without any fault nothing is lost."""

import pytest
from e2e.serving import KEYS, Service
from faults.harness.processes import Fleet
from sim.until import until


@pytest.fixture
def service(tmp_path):
    service = Service(tmp_path, {"HEADWAY_STATE_DIR": str(tmp_path / "state")})
    yield service
    service.process.kill()
    service.process.wait(10.0)


def test_every_message_of_a_calm_fleet_is_judged(service, measured) -> None:
    fleet = Fleet(service.endpoint, KEYS.site, cars=10, seconds=8.0)
    sent = sum(fleet.sent().values())
    fleet.kill()
    outcomes = service.metric("headway_records_total")
    until(lambda: sum(service.metric("headway_records_total").values()) >= sent)
    outcomes = service.metric("headway_records_total")
    judged = outcomes["scored"] + outcomes["warming"]
    measured("none: 10 cars for 8 s", f"{judged:.0f} of {sent} judged", "all")
    assert judged == sent
