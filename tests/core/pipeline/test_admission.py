"""Which records are admitted, and the rows of their vehicles."""

import numpy as np

from headway.core.pipeline.admission import admit, reject_by_age
from headway.core.tracking.vehicle_table import VehicleTable
from headway.core.types.identifiers import id_column, id_words
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


def test_vehicles_and_their_declared_leaders_have_the_rows_of_the_table() -> None:
    table = VehicleTable(8)
    table.admit(["a", "b"])
    received, outcomes, rows, leader_rows = np.full(3, S), np.empty(3, np.uint8), np.empty(3, int), np.empty(3, int)

    def admitted(ids: list[str | None], leaders: list[str | None]) -> bool:
        words = id_words(id_column(ids)), id_words(id_column(leaders))
        return admit(table.id_index, *words, received, received, 5e6, 1e6, outcomes, rows, leader_rows)

    assert admitted(["b", "a", "b"], [None, "b", "c"])
    assert (rows.tolist(), leader_rows.tolist()) == ([1, 0, 1], [-1, 1, -1])
    assert not admitted(["b", "c", "a"], [None, None, None])
    assert (rows.tolist(), leader_rows.tolist()) == ([1, -1, 0], [-1, -1, -1])
    assert outcomes.tolist() == [Outcome.SCORED] * 3
