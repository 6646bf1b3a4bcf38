import math

import numpy as np
import pytest

from headway.core.tail import TAIL, TailParams, alarms_per_hour, tail_gate, tail_learn

P = TailParams(budget_per_hour=1.0)


def fresh() -> np.void:
    return np.zeros(1, TAIL)[0]


def excursions(tail: np.void, peaks: np.ndarray, apart_s: float) -> None:
    for peak in peaks:
        tail_learn(tail, peak, 1e9, 1.0, P)
        tail_learn(tail, 0.0, 1e9, apart_s - 1.0, P)


def test_a_fresh_gate_is_that_of_the_prior() -> None:
    """200 excursions an hour that exceed 2 by 0.5 on average: 200 exp(-(g - 2) / 0.5) = 1."""
    assert tail_gate(fresh(), P) == pytest.approx(2.0 + 0.5 * math.log(200.0))


def test_the_gate_is_passed_as_often_as_the_budget_says() -> None:
    rng = np.random.default_rng(2)
    tail = fresh()
    excursions(tail, 2.0 + rng.exponential(0.8, 5000), 30.0)
    assert alarms_per_hour(tail, tail_gate(tail, P), P) == pytest.approx(1.0)
    hours = 5000 * 30.0 / 3600.0
    later = 2.0 + rng.exponential(0.8, 500_000)
    assert (later > tail_gate(tail, P)).sum() / (100 * hours) == pytest.approx(1.0, rel=0.2)


def test_a_smaller_budget_asks_for_a_higher_gate() -> None:
    gates = [tail_gate(fresh(), P._replace(budget_per_hour=budget)) for budget in (10.0, 1.0, 0.1)]
    assert gates == sorted(gates)
    assert gates[0] < gates[2]


def test_quiet_hours_lower_the_gate_and_never_below_where_peaks_begin() -> None:
    tail = fresh()
    before = tail_gate(tail, P)
    tail_learn(tail, 0.0, before, 1e9, P)
    assert P.from_z <= tail_gate(tail, P) < before


def test_a_lie_beyond_the_gate_moves_it_no_more_than_a_peak_at_the_gate() -> None:
    tails = fresh(), fresh()
    gate = tail_gate(tails[0], P)
    for tail, peak in zip(tails, (gate, 1000.0), strict=True):
        tail_learn(tail, peak, gate, 1.0, P)
        tail_learn(tail, 0.0, gate, 1.0, P)
    assert tail_gate(tails[0], P) == tail_gate(tails[1], P)
