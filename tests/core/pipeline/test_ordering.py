"""The order of a batch: by event time, and no vehicle twice in a round."""

import numpy as np

from headway.core.pipeline.ordering import reject_by_age, rounds
from headway.core.types.outcome import Outcome

S = 1_000_000


def test_too_old_and_from_the_future_are_named_and_the_limits_are_inside() -> None:
    received = np.full(5, 100 * S)
    t_us = received - np.array([5 * S, 5 * S + 1, 0, -S, -S - 1])
    outcomes = np.empty(5, np.uint8)
    reject_by_age(t_us, received, 5e6, 1e6, outcomes)
    assert [Outcome(o) for o in outcomes] == [
        Outcome.SCORED, Outcome.TOO_OLD, Outcome.SCORED, Outcome.SCORED, Outcome.FROM_THE_FUTURE,
    ]  # fmt: skip


def test_rounds_are_the_same_as_sorting_and_counting() -> None:
    rng = np.random.default_rng(4)
    seen = np.zeros(20, np.int64)
    for size in (1, 7, 300):
        rows, t_us = rng.integers(0, 20, size), rng.integers(0, 40, size)
        outcomes = rng.choice([np.uint8(Outcome.SCORED), np.uint8(Outcome.TOO_OLD)], size)
        order, nth, count = rounds(rows, t_us, outcomes, seen)
        expected = sorted(np.flatnonzero(outcomes == Outcome.SCORED), key=lambda i: (t_us[i], rows[i]))
        assert sorted(zip(t_us[order], rows[order], strict=True)) == list(zip(t_us[order], rows[order], strict=True))
        assert sorted(order.tolist()) == sorted(expected)
        before: dict[int, int] = {}
        for i, n in zip(order, nth, strict=True):
            assert n == before.get(rows[i], 0)
            before[rows[i]] = n + 1
        assert count == max(before.values(), default=0)
        assert not seen.any()


def test_no_accepted_record_is_no_round() -> None:
    order, nth, count = rounds(
        np.array([-1]), np.array([5]), np.array([Outcome.TABLE_FULL], np.uint8), np.zeros(1, np.int64)
    )
    assert (order.size, nth.size, count) == (0, 0, 0)
