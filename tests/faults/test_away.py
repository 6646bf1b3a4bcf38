"""A router that is down, a service that is stopped: what senders put meanwhile is counted when they are back."""

import time

import pytest
from e2e.serving import KEYS, Service
from faults.conftest import DEPLOYED
from faults.harness.processes import Fleet, Router
from sim.loopback import free_endpoint
from sim.until import until

CARS, BEFORE_S, AFTER_S = 20, 8.0, 14.0


@pytest.mark.parametrize("down_s", [2.0, 10.0, 60.0])
def test_router_down(start, measured, down_s: float) -> None:
    endpoint = free_endpoint()
    router = Router(endpoint, DEPLOYED / "trial.json5")
    until(lambda: router.ready)
    service = start(router)
    with Fleet(endpoint, KEYS.site, cars=CARS, seconds=BEFORE_S + down_s + AFTER_S) as fleet:
        time.sleep(BEFORE_S)
        router.kill()
        time.sleep(down_s)
        with Router(endpoint, DEPLOYED / "trial.json5") as router:
            until(lambda: router.ready)
            sent = sum(fleet.sent().values())
            time.sleep(1.0)
            accounted = arrived(service)
            gaps = service.metric("headway_sequence_gap_messages_total")[""]
    [span] = service.said("what was sent in this time was not received")
    got = f"{sent - accounted - gaps:.0f} of {sent} unaccounted, {gaps:.0f} in gaps, span {span['seconds']:.1f} s"
    measured(f"router down for {down_s:.0f} s", got, "unaccounted 0")
    assert accounted + gaps == sent
    assert span["seconds"] >= down_s - 1.0


def test_service_stopped(start, router, measured) -> None:
    stopped_s = 30.0
    service = start(router)
    with Fleet(router.endpoint, KEYS.site, cars=CARS, seconds=BEFORE_S + stopped_s + AFTER_S + 10.0) as fleet:
        time.sleep(BEFORE_S)
        assert service.stop() == 0
        [end] = service.said("stopping")
        before = end["scored"] + end["warming"] + sum(end["rejected"].values())
        gaps_before = end["sequence_gap_messages"]
        time.sleep(stopped_s)
        service = start(router)
        sent = sum(fleet.sent().values())
        time.sleep(1.0)
        accounted = before + arrived(service)
        gaps = gaps_before + service.metric("headway_sequence_gap_messages_total")[""]
    [span] = service.said("what was sent in this time was not received")
    got = f"{sent - accounted - gaps:.0f} of {sent} unaccounted, {gaps:.0f} in gaps, span {span['seconds']:.1f} s"
    measured(f"service stopped for {stopped_s:.0f} s", got, "unaccounted 0")
    assert accounted + gaps == sent
    assert span["seconds"] >= stopped_s


def arrived(service: Service) -> int:
    """Return how many records had an outcome and no gap in the counters: one that is shed has both."""
    outcomes = service.metric("headway_records_total")
    return round(sum(outcomes.values()) - outcomes["shed"] - outcomes["stale"])
