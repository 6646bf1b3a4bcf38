"""A surge read off the service's own reports: what it judged, what it shed, and when it was normal again."""

import numpy as np
import pytest

from headway_loadtest.measure.accounting import Counters
from headway_loadtest.measure.overload import Surged, assess_surge
from headway_loadtest.measure.subscriber import Health
from headway_loadtest.traffic.fleet import COHORT, FleetFrames
from headway_loadtest.traffic.surge import Surge

S = 1_000_000_000
SURGE = Surge(vehicles=100, start_s=5.0, seconds=5.0)


def reports(p99_ms_of_second: list[float], lost_in: dict[int, int] | None = None) -> list[Health]:
    """One report a second from the start on; in each second 100 records are judged, all as late as its p99."""
    counts: dict[float, int] = {}
    scored, lost, made = 0, 0, []
    for second, p99_ms in enumerate([0.0, *p99_ms_of_second]):
        if second:
            counts[1e3 * p99_ms] = counts.get(1e3 * p99_ms, 0) + 100
            scored += 100
            lost += (lost_in or {}).get(second, 0)
        counters = Counters(scored, 0, {}, {"stale": lost}, 0, 0)
        content = {"histograms_us": {"intended": sorted(counts.items())}}
        made.append(Health(second * S, "i", counters, content))
    return made


def assess(health: list[Health]) -> Surged:
    return assess_surge(health, SURGE, "intended", warm_ns=S, start_ns=0)


def test_recovery_is_counted_from_the_end_of_the_surge_to_the_first_normal_second() -> None:
    surged = assess(reports([9, 4, 5, 4, 4, 80, 900, 900, 900, 900, 700, 300, 11, 9, 5], {9: 30, 12: 5}))
    assert surged.normal_p99_ms == 10.0
    assert surged.recovered_s == 3.0
    assert surged.lost == 35
    assert surged.judged_hz == 100.0
    assert surged.latency is not None
    assert surged.latency.p99 == 900.0


def test_a_second_that_sheds_is_not_normal() -> None:
    surged = assess(reports([4] * 15, {11: 1, 12: 1}))
    assert surged.recovered_s == 2.0


def test_a_surge_that_nobody_felt_is_over_at_once() -> None:
    assert assess(reports([4] * 15)).recovered_s == 0.0


@pytest.mark.parametrize("health", [reports([4] * 5 + [900] * 10), reports([4])])
def test_a_service_that_does_not_recover_has_no_time_for_it(health: list[Health]) -> None:
    assert assess(health).recovered_s is None


def test_the_vehicles_of_a_surge_come_and_go_and_keep_their_place_in_time() -> None:
    surge = Surge(vehicles=2 * COHORT, start_s=0.3, seconds=0.4)
    frames = list(FleetFrames(COHORT, 1.0, seed=1, surge=surge))
    t_us = np.concatenate([frame.t_us for frame in frames])
    rows = np.concatenate([frame.row for frame in frames])
    assert np.all(np.diff(t_us) >= 0)
    sent = np.bincount(rows)
    assert set(sent[:COHORT]) == {10}
    assert set(sent[COHORT:]) == {4}
    surging = t_us[rows >= COHORT]
    assert surging.min() >= 300_000
    assert surging.max() < 700_000
    names = [vehicle.id for frame in frames for vehicle in frame.entering]
    assert len(set(names)) == len(names) == 3 * COHORT
