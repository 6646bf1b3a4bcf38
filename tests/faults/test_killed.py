"""A service that is killed again and again: bus and journal agree, no event stays open, vehicles are known again."""

import time

from e2e.serving import KEYS
from faults.harness.processes import Fleet, Subscriber
from sim.until import until

KILLS, CARS, FAULTY = 20, 40, 10
KILL_S, CALM_S = 220.0, 30.0
AGREE_S, JUDGED_S, ENDED_S = 5.0, 1.0, 60.0
KNOWN = 0.9
"""Share of records in the first second that are scored: vehicles are known."""
BRIDGED_S = 4.0
"""From the kill until ready: `max_gap_s`, less the age of the snapshot and an interval between messages."""


def test_killed_twenty_times(start, router, history, measured) -> None:
    service = start(router)  # before the fleet: the first start may compile
    with (
        Subscriber(router.endpoint, KEYS.site) as bus,
        Fleet(
            router.endpoint, KEYS.site, cars=CARS, seconds=KILL_S + CALM_S, faulty=FAULTY, fault_s=6.0,
            fault_every_s=4.0, until_s=KILL_S,
        ) as fleet,
    ):  # fmt: skip
        begin_s, shares, agree_s, gaps_s = time.monotonic(), [], [], []
        until(lambda: service.metric("headway_records_total")["scored"] > 20 * CARS)  # all were warm for a snapshot
        for kill in range(KILLS):
            ready_s = time.monotonic()
            until(lambda: _lacking(bus, history(router.endpoint)) == set())
            agree_s.append(time.monotonic() - ready_s)
            time.sleep(max(0.0, ready_s + 1.5 + 0.1 * kill - time.monotonic()))
            killed_s = time.monotonic()
            service.kill()
            service = start(router)
            gaps_s.append(time.monotonic() - killed_s)
            time.sleep(JUDGED_S)
            outcomes = service.metric("headway_records_total")
            shares.append(outcomes["scored"] / (outcomes["scored"] + outcomes["warming"]))

        until(lambda: fleet.popen.poll() is not None, KILL_S + CALM_S)
        assert time.monotonic() - begin_s > KILL_S, "the fleet ended before the last kill"
        fleet.sent()
        end_s = time.monotonic()
        until(lambda: not _open(bus.alerts), ENDED_S)
        alerts = bus.alerts
        onsets = {a["event_id"] for a in alerts if a["phase"] == "onset"}
        lacking = _lacking(bus, history(router.endpoint))
    bridged = [share > KNOWN for share, gap_s in zip(shares, gaps_s, strict=True) if gap_s < BRIDGED_S]
    got = (
        f"agree {max(agree_s):.1f} s, 0 of {len(onsets)} open after {time.monotonic() - end_s:.0f} s,"
        f" {sum(bridged)} of {len(bridged)} warm, longest start {max(gaps_s):.1f} s"
    )
    measured(f"kill -9 x {KILLS}", got, "5 s, 0 open after 60 s, known within 1 s")
    assert onsets
    assert not lacking
    assert max(agree_s) <= AGREE_S
    assert all(bridged)


def _lacking(bus: Subscriber, written: list) -> set[int]:
    """Sequence numbers of updates that the journal has and the bus never had."""
    return {event.sequence for event in written} - {alert["sequence"] for alert in bus.alerts}


def _open(alerts: list[dict]) -> set[str]:
    of = {phase: {a["event_id"] for a in alerts if a["phase"] == phase} for phase in ("onset", "cleared")}
    return of["onset"] - of["cleared"]
