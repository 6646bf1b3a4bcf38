"""The order in which a batch is taken: that of arrival, in slots, and in rounds that see what came before."""

import numpy as np

from headway.core.pipeline.ordering import SLOT_US, receive_times, rounds
from headway.core.types.outcome import Outcome

S = 1_000_000


def rounds_one_by_one(rows: list[int], leaders: list[int], suspects: list[int]) -> list[int]:
    """After all earlier records of the vehicle, and not before any with a vehicle in common."""
    concerned = [{row, leaders[row], suspects[row]} - {-1} for row in rows]
    nth: list[int] = []
    for i, row in enumerate(rows):
        after = [nth[j] + 1 for j in range(i) if rows[j] == row]
        not_before = [nth[j] for j in range(i) if concerned[j] & concerned[i]]
        nth.append(max(after + not_before, default=0))
    return nth


def test_the_round_of_a_record_comes_after_that_of_the_vehicle_before() -> None:
    rng = np.random.default_rng(4)
    workspace = np.zeros((20, 2), np.int64)
    for size in (1, 7, 300):
        rows, leaders, suspects = rng.integers(0, 20, size), rng.integers(-1, 20, 20), rng.integers(-1, 20, 20)
        outcomes = rng.choice([np.uint8(Outcome.SCORED), np.uint8(Outcome.TOO_OLD)], size)
        places, nth, count = rounds(rows, leaders, suspects, outcomes, workspace)
        accepted = np.flatnonzero(outcomes == Outcome.SCORED)
        assert places.tolist() == accepted.tolist()
        assert nth.tolist() == rounds_one_by_one(rows[accepted].tolist(), leaders.tolist(), suspects.tolist())
        assert count == max(nth, default=-1) + 1
        assert not workspace.any()


def test_no_record_is_no_round() -> None:
    outcomes, workspace = np.array([Outcome.TABLE_FULL], np.uint8), np.zeros((1, 2), np.int64)
    places, nth, count = rounds(np.array([-1]), np.array([-1]), np.array([-1]), outcomes, workspace)
    assert (places.size, nth.size, count) == (0, 0, 0)


def test_time_of_reception_does_not_go_back_unless_the_clock_is_set_back() -> None:
    received = 100 * S + np.array([0, 5_000, 2_000, 12_000, 12_001, 9_999, -2 * S, -2 * S + 1])
    times, starts = np.empty(8, np.int64), np.empty(8, np.int64)
    count = receive_times(received, 0, times, starts)
    assert (times - 100 * S).tolist() == [0, 5_000, 5_000, 12_000, 12_001, 12_001, -2 * S, -2 * S + 1]
    assert starts[:count].tolist() == [0, 3, 6]
    count = receive_times(received[:1], int(100 * S + 1.5 * SLOT_US), times, starts)
    assert (int(times[0]), starts[:count].tolist()) == (100 * S + 1.5 * SLOT_US, [0])
