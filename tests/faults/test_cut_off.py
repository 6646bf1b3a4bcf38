"""A subscriber whose machine is cut off, or loses power, holds up neither detection nor any other subscriber.

No packet says that it is gone. So its connection ends by zenoh's lease, with alerts that nobody has acknowledged.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.serving import KEYS, Service
from faults.harness import network
from faults.harness.processes import Fleet, Router, Subscriber
from sim.loopback import free_endpoint
from sim.until import until

ROUTER = Path(__file__).resolve().parents[2] / "deploy" / "zenoh" / "trial.json5"
CARS, SECONDS, FAULTY = 100, 40.0, 20
CUT_S = 8.0
LATE_S_MAX, JUDGED_MIN = 1.0, 0.99

pytestmark = pytest.mark.skipif(not network.IS_POSSIBLE, reason=network.REASON)


@pytest.fixture
def apart() -> Iterator[network.Network]:
    with network.Network(8) as apart:
        yield apart


@pytest.fixture(params=["peer", "trial.json5"])
def site(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Service, str]]:
    """A service, and the port on which senders and subscribers reach it, or its router, at any address."""
    port = free_endpoint().rpartition(":")[2]
    everywhere, here = f"tcp/0.0.0.0:{port}", f"tcp/127.0.0.1:{port}"
    more = {"HEADWAY_VEHICLE_CAPACITY": "1000", "HEADWAY_SUSPECT_BURST": "10000"}
    if request.param == "peer":
        service = Service(tmp_path, more, everywhere)
        yield service, port
    else:
        with Router(everywhere, ROUTER) as router:
            until(lambda: router.ready)
            service = Service(
                tmp_path, {**more, "HEADWAY_MODE": "client", "HEADWAY_CONNECT": here, "HEADWAY_LISTEN": ""}
            )
            yield service, port
    service.kill()


def test_others_go_on(site, apart: network.Network, request, measured) -> None:
    service, port = site
    here = f"tcp/127.0.0.1:{port}"
    with (
        Subscriber(here, KEYS.site) as healthy,
        Subscriber(f"tcp/{apart.own}:{port}", KEYS.site, inside=apart.inside) as one,
        Subscriber(f"tcp/{apart.own}:{port}", KEYS.site, inside=apart.inside) as other,
        Fleet(here, KEYS.site, cars=CARS, seconds=SECONDS, faulty=FAULTY, fault_every_s=2.0) as fleet,
    ):
        until(lambda: healthy.ready and one.ready and other.ready)
        until(lambda: one.alerts and other.alerts, 60.0)
        time.sleep(CUT_S)
        apart.cut()
        sent = sum(fleet.sent().values())
        time.sleep(2.0)
        outcomes = service.metric("headway_records_total")
        alerts = healthy.alerts
    numbers = {alert["sequence"] for alert in alerts}
    missing = max(numbers) - min(numbers) + 1 - len(numbers)
    judged = (outcomes["scored"] + outcomes["warming"]) / sent
    latest_s = max((alert["received_us"] - alert["detected_us"]) / 1e6 for alert in alerts)
    measured(
        f"subscribers cut off, {request.node.callspec.params['site']}",
        f"{judged:.4f} judged, {len(alerts)} alerts, {missing} missing, latest {latest_s:.2f} s",
        ">= .99, <= 1 s late",
    )
    assert judged >= JUDGED_MIN
    assert missing == 0
    assert latest_s <= LATE_S_MAX
