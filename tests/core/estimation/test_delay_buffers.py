"""The delay buffers: what they give back, before, between and after their entries."""

from math import isnan

import numpy as np
import pytest

from headway.core.estimation.delay_buffers import SPACING_S, input_at, own_at, push_input, push_own, slots
from headway.core.estimation.registry import paper_dtype

DELAY_S = 1.5


@pytest.fixture
def row():
    return np.zeros(1, paper_dtype(2, DELAY_S)).view(np.recarray)[0]


def remember(row, t, x, v, p=1.0) -> None:
    row.s[:] = (x, v)
    row.P[:, :] = p * np.eye(2)
    push_own(row, t)


def own(row, t):
    s, P = np.empty(2), np.empty((2, 2))
    own_at(row, t, s, P)
    return s, P


def test_between_entries_the_past_is_on_the_straight_line(row) -> None:
    remember(row, 0.0, 0.0, 10.0, p=1.0)
    remember(row, 0.1, 2.0, 20.0, p=3.0)
    s, P = own(row, 0.025)
    assert s == pytest.approx([0.5, 12.5])
    assert pytest.approx(1.5 * np.eye(2)) == P


def test_before_the_first_entry_the_car_kept_its_speed_and_after_the_newest_the_newest_holds(row) -> None:
    remember(row, 1.0, 50.0, 10.0)
    remember(row, 1.1, 51.0, 11.0)
    assert own(row, 0.5)[0] == pytest.approx([45.0, 10.0])
    assert own(row, 9.0)[0] == pytest.approx([51.0, 11.0])


def test_uneven_intervals_are_met_at_their_own_times(row) -> None:
    times = np.cumsum([0.0, 0.1, 0.35, 0.09, 0.6, 0.1])
    for t in times:
        remember(row, t, t**2, 2.0 * t)
    for t in (0.05, 0.3, 0.5, 0.9, 1.2):
        assert own(row, t)[0] == pytest.approx([np.interp(t, times, times**2), 2.0 * t])


@pytest.mark.parametrize("interval_s", [0.005, 0.02, 0.05, 0.079, 0.1, 0.3])
def test_a_ring_reaches_back_tau_however_often_the_sender_speaks(row, interval_s: float) -> None:
    for k in range(int(20.0 / interval_s)):
        remember(row, k * interval_s, 10.0 * k * interval_s, 10.0)
        push_input(row, k * interval_s, 10.0 * k * interval_s, 10.0)
    now = row.own_t.max()
    oldest = max(0.0, row.own_t.min())
    assert now - oldest >= DELAY_S
    assert own(row, now - DELAY_S)[0] == pytest.approx([10.0 * (now - DELAY_S), 10.0])
    assert input_at(row, now - DELAY_S)[:2] == pytest.approx((10.0 * (now - DELAY_S), 10.0))


def test_a_dense_sender_is_thinned_and_a_nominal_one_kept_whole(row) -> None:
    for k in range(10):
        remember(row, 0.1 * k, 0.0, 0.0)
    assert row.own_count == 10
    for k in range(1, 9):
        remember(row, 0.9 + 0.01 * k, 0.0, float(k))
    assert row.own_count == 11
    assert own(row, 2.0)[0][1] == 8.0
    kept = np.sort(row.own_t[: row.own_count])[:-1]
    assert np.diff(kept).min() >= SPACING_S


def test_a_leader_that_changes_leaves_the_past_as_it_was(row) -> None:
    for k in range(10):
        push_input(row, 0.1 * k, 100.0 + k, 10.0)
    for k in range(10, 15):
        push_input(row, 0.1 * k, 40.0 + k, 12.0)
    assert input_at(row, 0.45) == pytest.approx((104.5, 10.0, 0.0))
    assert input_at(row, 1.35) == pytest.approx((53.5, 12.0, 0.0))


def test_the_leaders_acceleration_is_the_slope_of_his_speed(row) -> None:
    push_input(row, 0.0, 0.0, 10.0)
    push_input(row, 0.2, 2.0, 10.5)
    assert input_at(row, 0.1) == pytest.approx((1.0, 10.25, 2.5))


def test_outside_the_ring_the_leader_kept_his_speed(row) -> None:
    push_input(row, 1.0, 10.0, 8.0)
    assert input_at(row, 0.0) == pytest.approx((2.0, 8.0, 0.0))
    assert input_at(row, 1.5) == pytest.approx((14.0, 8.0, 0.0))


def test_nobody_ahead_is_not_a_number_now_and_in_memory(row) -> None:
    assert all(map(isnan, input_at(row, 0.0)))
    push_input(row, 0.0, 10.0, 8.0)
    push_input(row, 0.1, 10.8, 8.0)
    push_input(row, 0.2, np.nan, np.nan)
    assert input_at(row, 0.05)[0] == pytest.approx(10.4)
    assert all(isnan(input_at(row, t)[0]) for t in (0.15, 0.2, 0.3))


def test_a_leader_sample_that_is_not_newer_is_ignored(row) -> None:
    push_input(row, 1.0, 10.0, 8.0)
    for late in (1.0, 0.9):
        push_input(row, late, 99.0, 99.0)
    assert row.input_count == 1
    assert input_at(row, 1.0) == (10.0, 8.0, 0.0)


def test_a_longer_delay_has_more_slots() -> None:
    assert slots(0.0) < slots(0.5) < slots(5.0)
    assert (slots(5.0) - 2) * SPACING_S >= 5.0
