"""A service that is killed again and again: bus and journal agree, no event stays open, vehicles are known again."""

import time

from e2e.serving import KEYS
from faults.harness.processes import Fleet, Subscriber
from sim.until import until

KILLS, CARS, FAULTY = 20, 40, 10
KILL_S, CALM_S = 240.0, 30.0
AGREE_S, JUDGED_S, ENDED_S = 5.0, 1.0, 60.0
LOOKED_S = 0.4
"""After the time in which vehicles must be judged, so long it is counted whether they are."""


def test_killed_twenty_times(start, router, history, measured) -> None:
    service = start(router)  # before the fleet: the first start may compile
    with (
        Subscriber(router.endpoint, KEYS.site, catch_up=True) as bus,
        Fleet(
            router.endpoint, KEYS.site, cars=CARS, seconds=KILL_S + CALM_S, faulty=FAULTY, fault_s=6.0,
            fault_every_s=4.0, until_s=KILL_S,
        ) as fleet,
    ):  # fmt: skip
        shares, agree_s, gaps_s = [], [], []
        until(lambda: service.metric("headway_records_total")["scored"] > 20 * CARS)  # all were warm for a snapshot
        ready_s = time.monotonic()
        for kill in range(KILLS):
            until(lambda: _lacking(bus, history(router.endpoint)) == set())
            agree_s.append(time.monotonic() - ready_s)
            time.sleep(max(0.0, ready_s + 1.5 + 0.1 * kill - time.monotonic()))
            killed_s = time.monotonic()
            service.kill()
            service = start(router)
            ready_s = time.monotonic()
            gaps_s.append(ready_s - killed_s)
            time.sleep(JUDGED_S)
            before = service.metric("headway_records_total")
            time.sleep(LOOKED_S)
            outcomes = service.metric("headway_records_total")
            scored, warming = (outcomes[name] - before[name] for name in ("scored", "warming"))
            shares.append(scored / (scored + warming))

        assert fleet.popen.poll() is None, "the fleet ended before the last kill"
        until(lambda: fleet.popen.poll() is not None, KILL_S + CALM_S)
        fleet.sent()
        end_s = time.monotonic()
        until(lambda: not _open(bus.alerts), ENDED_S)
        onsets = {a["event_id"] for a in bus.alerts if a["phase"] == "onset"}
        closed_s = time.monotonic()
        until(lambda: _lacking(bus, history(router.endpoint)) == set())
        agree_s.append(time.monotonic() - closed_s)
    judged = shares.count(1.0)
    got = (
        f"agree {max(agree_s):.1f} s, 0 of {len(onsets)} open after {closed_s - end_s:.0f} s,"
        f" all judged after {judged} of {KILLS} starts of up to {max(gaps_s):.1f} s"
    )
    measured(f"kill -9 x {KILLS}", got, "5 s, 0 open after 60 s, judged within 1 s")
    assert onsets
    assert max(agree_s) <= AGREE_S
    assert judged == KILLS, shares


def _lacking(bus: Subscriber, written: list) -> set[int]:
    """Sequence numbers of updates that the journal has and a subscriber never had."""
    return {event.sequence for event in written} - {alert["sequence"] for alert in bus.alerts}


def _open(alerts: list[dict]) -> set[str]:
    of = {phase: {a["event_id"] for a in alerts if a["phase"] == phase} for phase in ("onset", "cleared")}
    return of["onset"] - of["cleared"]
