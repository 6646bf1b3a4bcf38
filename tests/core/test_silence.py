"""A miss needs a late sender and somebody who heard others meanwhile."""

import numpy as np

from headway.core import silence
from headway.core.records import Kind
from headway.core.turn import Phase
from headway.core.vehicles import VehicleTable

S = 1_000_000


def test_never_before_600_ms_and_never_before_three_intervals() -> None:
    limit = silence.limit_us(np.array([0.1, 0.2, 0.5]), 0.6)
    assert limit.tolist() == [600_000, 600_000, 1_500_000]


def test_leader_and_follower_are_each_others_witness() -> None:
    heard = np.array([100, 200, 300, 0])
    witness = silence.last_witness_us(heard, np.array([0, 1, 2]), np.array([-1, 0, 1]))
    assert witness.tolist() == [200, 300, 200]


def test_late_only_while_a_neighbour_is_still_heard() -> None:
    now = 10 * S
    heard = np.array([9 * S, 9 * S, int(9.9 * S)])
    witness = np.array([now, 9 * S, now])
    assert silence.late(now, heard, witness, np.full(3, 600_000)).tolist() == [True, False, False]


def test_an_ear_that_heard_nobody_was_not_open() -> None:
    ear = silence.Ear()
    ear.hear(np.arange(0, 2 * S, 50_000))
    assert ear.was_open(S // 2, 3 * S // 2)
    assert not ear.was_open(2 * S, 4 * S)
    assert not ear.was_open(S, S + 50_000)


def test_a_miss_begins_and_ends_under_one_id() -> None:
    vehicles = VehicleTable(2)
    follower, leader = vehicles.admit(["a", "b"])
    log = silence.MissLog(vehicles, 2)
    onset = log.begin(follower, leader, 5 * S, 6 * S)
    assert (onset.phase, onset.kind, onset.suspect, onset.leader) == (Phase.ONSET, Kind.MISS, "a", "b")
    assert log.active[follower]
    cleared = log.end(follower, -1, 8 * S, 9 * S)
    assert (cleared.phase, cleared.event_id, cleared.leader) == (Phase.CLEARED, onset.event_id, None)
    assert len(log) == 0
