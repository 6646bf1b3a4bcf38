"""A miss needs an overdue sender, and messages of others meanwhile."""

import numpy as np
import pytest

from headway.core.events.miss_log import MissLog
from headway.core.tracking import reception, tracks
from headway.core.tracking.coverage import new_coverage
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.records import Kind
from headway.core.types.step_result import Phase

S = 1_000_000


def track(interval_s: float = 0.1, longest_interval_s: float = 0.0, loss: float = 0.0, longest_loss: float = 0.0):
    """One well-known track of such a sender and channel."""
    [made] = tracks.new_tracks(1)
    made["interval_s"], made["longest_interval_s"] = interval_s, max(interval_s, longest_interval_s)
    made["loss"], made["longest_loss"] = loss, longest_loss
    return made


@pytest.mark.parametrize(
    ("interval_s", "longest_s", "limit_s"), [(0.1, 0.1, 0.75), (0.2, 0.2, 1.1), (0.5, 0.5, 1.5), (0.3, 1.0, 2.0)]
)
def test_a_pause_is_measured_by_the_senders_own_intervals(interval_s: float, longest_s: float, limit_s: float) -> None:
    assert reception.pause_limit_us(track(interval_s, longest_s), 0.6) == pytest.approx(limit_s * S, abs=2)


def test_a_channel_that_loses_gives_the_sender_more_time() -> None:
    clear, lossy = reception.limit_us(track(), 0.6), reception.limit_us(track(loss=0.3, longest_loss=2.0), 0.6)
    assert clear == pytest.approx(1.15 * S, abs=2)
    assert 0.5 ** ((lossy / S - 0.15) / 0.1) == pytest.approx(reception.CHANCE, rel=0.01)


def test_leader_and_follower_are_each_others_neighbour_where_the_road_ahead_is_covered() -> None:
    received, rows, leaders = np.array([100, 200, 300, 0]), np.array([0, 1, 2]), np.array([-1, 0, 1])
    everywhere, nowhere = np.ones(4, np.bool_), np.zeros(4, np.bool_)
    assert reception.last_neighbour_us(received, rows, leaders, everywhere).tolist() == [200, 300, 200]
    assert reception.last_neighbour_us(received, rows, leaders, nowhere).tolist() == [0, 100, 200]


def silent(last_received_us: list[int]) -> np.ndarray:
    """Tracks of vehicles at 10 Hz, past warming, last received at these times."""
    known = tracks.new_tracks(len(last_received_us))
    known["received_us"], known["t_us"] = last_received_us, last_received_us
    known["count"], known["interval_s"] = 100, 0.1
    return known


def test_overdue_only_while_a_neighbour_is_received() -> None:
    known = silent([9 * S, 9 * S, int(10.9 * S), 9 * S])
    leaders = np.array([2, 3, -1, -1])
    overdue = reception.overdue(known, new_coverage(), np.arange(4), leaders, np.zeros(4, np.bool_), 11 * S, 0.6, 30)
    assert overdue.tolist() == [True, False, False, False]


def test_ignored_and_little_known_vehicles_are_not_overdue() -> None:
    known = silent([9 * S, 9 * S, int(10.9 * S)])
    known["count"][1] = 30
    leaders, ignored = np.array([2, 2, -1]), np.array([True, False, False])
    assert not reception.overdue(known, new_coverage(), np.arange(3), leaders, ignored, 11 * S, 0.6, 30).any()


def test_a_new_vehicle_at_the_extrapolated_place_is_a_changed_pseudonym() -> None:
    known = silent([9 * S, int(9.5 * S), int(9.5 * S)])
    known["v_mps"], known["heading_north"] = 20.0, 1.0
    known["lat_deg"] = 42.0 + np.array([0.0, 10.0, 200.0]) / 111_000.0
    first_received = np.array([0, int(9.1 * S), int(9.1 * S)])
    rows = np.arange(3)
    assert reception.pseudonym_changed(known, first_received, 0, rows)
    assert not reception.pseudonym_changed(known, np.array([0, 8 * S, int(9.1 * S)]), 0, rows)


def test_a_monitor_without_messages_was_not_receiving() -> None:
    monitor = reception.ReceptionMonitor()
    monitor.record(np.arange(0, 2 * S, 50_000))
    assert monitor.was_receiving(S // 2, 3 * S // 2)
    assert not monitor.was_receiving(2 * S, 4 * S)
    assert not monitor.was_receiving(S, S + 50_000)


def test_a_miss_starts_and_ends_under_one_id() -> None:
    vehicles = VehicleTable(2)
    follower, leader = vehicles.admit(["a", "b"])
    log = MissLog(vehicles, 2)
    onset = log.start(follower, leader, 5 * S, 6 * S, 7 * S)
    assert (onset.phase, onset.kind, onset.suspect, onset.leader) == (Phase.ONSET, Kind.MISS, "a", "b")
    assert log.active[follower]
    cleared = log.end(follower, -1, 8 * S, 9 * S, 9 * S)
    assert (cleared.phase, cleared.event_id, cleared.leader) == (Phase.CLEARED, onset.event_id, None)
    assert len(log) == 0
