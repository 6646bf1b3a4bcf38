"""Two services of one site judge the same traffic; one is restarted, and then says what the other says.

The faults of a vehicle are so far apart that each is an event of its own. Closer ones join to one event or not by
whether the first is over, which the span without messages decides.
"""

import time

from e2e.serving import KEYS
from faults.harness.processes import Fleet, Subscriber

CARS, FAULTY, SECONDS, RESTART_S, WARM_S = 40, 20, 60.0, 20.0, 8.0
FAULT_EVERY_S, SAME_MIN = 5.0, 0.9


def test_the_restarted_one_finds_what_the_other_finds(start, router, measured, tmp_path) -> None:
    states = {name: str(tmp_path / name) for name in ("steady", "restarted")}
    steady, restarted = (
        start(router, instance=name, state_dir=state, suspect_burst="10000") for name, state in states.items()
    )
    with (
        Subscriber(router.endpoint, KEYS.site) as bus,
        Fleet(
            router.endpoint, KEYS.site, cars=CARS, seconds=SECONDS, faulty=FAULTY, fault_every_s=FAULT_EVERY_S
        ) as fleet,
    ):  # fmt: skip
        time.sleep(RESTART_S)
        assert restarted.stop() == 0
        restarted = start(router, instance="restarted", state_dir=states["restarted"], suspect_burst="10000")
        time.sleep(WARM_S)
        warm_us = time.time_ns() // 1000
        counted = [service.metric("headway_records_total") for service in (steady, restarted)]
        fleet.sent()
        time.sleep(1.0)
        counted = [
            {name: service.metric("headway_records_total")[name] - before[name] for name in ("scored", "warming")}
            for service, before in zip((steady, restarted), counted, strict=True)
        ]
        onsets = [
            {
                a["event_id"]
                for a in bus.alerts
                if a["instance"] == name and a["phase"] == "onset" and a["t_us"] > warm_us
            }
            for name in states
        ]
    same = len(onsets[0] & onsets[1]) / len(onsets[0])
    got = f"{same:.2f} of {len(onsets[0])} onset ids; warming {counted[0]['warming']:.0f}, {counted[1]['warming']:.0f}"
    measured("after a restart, once warm", got, "the same scored, >= .9 of onset ids")
    assert same >= SAME_MIN
    assert abs(counted[0]["scored"] - counted[1]["scored"]) <= CARS
    assert counted[1]["warming"] <= counted[0]["warming"]
