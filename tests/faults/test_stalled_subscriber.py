"""A subscriber that takes nothing holds up neither detection nor any other subscriber."""

import time
from pathlib import Path

import pytest
from e2e.serving import KEYS, Service
from faults.harness.processes import Fleet, Router, Subscriber
from sim.loopback import free_endpoint
from sim.until import until

DEPLOYED = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
PLAIN = '{mode: "router", scouting: {multicast: {enabled: false}, gossip: {enabled: false}}}'
CARS, SECONDS, FAULTY = 600, 40.0, 100
STALL_AFTER = 100
LATE_S_MAX, JUDGED_MIN = 1.0, 0.99
MORE = {"HEADWAY_VEHICLE_CAPACITY": "1000", "HEADWAY_SUSPECT_BURST": "10000"}


@pytest.fixture(params=["peer", "plain router", "trial.json5"])
def site(request, tmp_path):
    """A service, and the endpoint that senders and subscribers use: its own, or that of a router."""
    more = MORE | {"HEADWAY_STATE_DIR": str(tmp_path / "state")}
    if request.param == "peer":
        service = Service(tmp_path, more)
        yield service, service.endpoint
    else:
        endpoint = free_endpoint()
        file = DEPLOYED / request.param
        if request.param == "plain router":
            file = tmp_path / "router.json5"
            file.write_text(PLAIN, encoding="utf-8")
        with Router(endpoint, file) as router:
            until(lambda: router.ready)
            service = Service(
                tmp_path, {**more, "HEADWAY_MODE": "client", "HEADWAY_CONNECT": endpoint, "HEADWAY_LISTEN": ""}
            )
            yield service, endpoint
    service.process.kill()
    service.process.wait(10.0)


def test_others_go_on(site, request, measured) -> None:
    service, endpoint = site
    with (
        Subscriber(endpoint, KEYS.site) as healthy,
        Subscriber(endpoint, KEYS.site, stall_after=STALL_AFTER) as stalled,
        Fleet(endpoint, KEYS.site, cars=CARS, seconds=SECONDS, faulty=FAULTY, fault_every_s=2.0) as fleet,
    ):
        until(lambda: healthy.ready and stalled.ready)
        sent = sum(fleet.sent().values())
        time.sleep(2.0)
        outcomes = service.metric("headway_records_total")
        alerts = healthy.alerts
        late_s = [(a["received_us"] - a["detected_us"]) / 1e6 for a in alerts]
        numbers = {a["sequence"] for a in alerts}
        unseen = max(numbers) - min(numbers) + 1 - len(numbers)
        named = service.said("subscriber disconnected")
    judged = (outcomes["scored"] + outcomes["warming"]) / sent
    got = f"{judged:.4f} judged, {len(alerts)} alerts, {unseen} missing, latest {max(late_s):.2f} s, named {len(named)}"
    measured(f"stalled subscriber, {request.node.callspec.params['site']}", got, ">= .99, <= 1 s late")
    assert judged >= JUDGED_MIN
    site_name = request.node.callspec.params["site"]
    assert max(late_s) <= LATE_S_MAX
    assert named or site_name != "peer"
