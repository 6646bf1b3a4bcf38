"""A calm network, and one in which messages overtake each other: each has one outcome, and nobody is blamed."""

import pytest
from e2e.serving import KEYS, Service
from faults.harness.processes import Fleet, Subscriber
from sim.until import until

CARS, SECONDS, LATE_S = 40, 25.0, 0.3


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


def test_reordered(start, measured) -> None:
    service = start()
    with (
        Subscriber(service.endpoint, KEYS.site) as bus,
        Fleet(service.endpoint, KEYS.site, cars=CARS, seconds=SECONDS, faulty=1, fault_s=15.0, late_s=LATE_S) as fleet,
    ):
        sent = sum(fleet.sent().values())
        until(lambda: sum(service.metric("headway_records_total").values()) >= sent)
        outcomes = service.metric("headway_records_total")
        until(lambda: bus.alerts)
        suspects = {alert["suspect"] for alert in bus.alerts}
    refused = {name: n for name, n in outcomes.items() if n and name not in ("scored", "warming")}
    judged = service.judged() / sent
    measured(
        f"reordered within {LATE_S} s", f"{judged:.2f} judged, {refused}, {suspects}", "accounted for, one suspect"
    )
    assert sum(outcomes.values()) == sent
    assert set(refused) <= {"out_of_order", "from_the_future"}
    assert refused["out_of_order"] > 0.1 * sent
    assert refused.get("from_the_future", 0) < 0.05 * sent, (
        "a lateness that varies by more than 0.25 s shows as a clock"
    )
    assert suspects == {f"car-{CARS - 1}"}
