"""Equation `idm` and its gradient, by hand and by difference."""

from math import inf, nan, sqrt

import numpy as np
import pytest

from headway.core.estimation.car_following import BRAKING_LIMIT_MPS2, GAP_FLOOR_M, IdmParams, idm

P = IdmParams()


def f(gap_m, v_mps, v_leader_mps, p=P):
    return idm(gap_m, v_mps, v_leader_mps, p)[0]


def test_the_defaults_are_the_papers() -> None:
    assert P == (1.0, 1.5, 4.0, 33.75, 2.0, 1.0)


def test_golden_value_worked_by_hand() -> None:
    """v = 10, v_leader = 8, d = 20: s* = 2 + 10 + 10 * 2 / (2 sqrt(1.5)); (10 / 33.75)^4 = 0.00770735..."""
    s_star = 12.0 + 20.0 / 2.449489742783178
    assert s_star == pytest.approx(20.164965809277261)
    assert f(20.0, 10.0, 8.0) == pytest.approx(1.0 - 0.0077073464 - (20.164965809277261 / 20.0) ** 2, abs=1e-9)


def test_standing_far_behind_a_standing_car_starts_as_the_gap_allows() -> None:
    """v = 0: s* = s0, so f = a (1 - (s0 / d)^2)."""
    assert f(10.0, 0.0, 0.0) == pytest.approx(0.96)
    assert f(P.s0_m, 0.0, 0.0) == pytest.approx(0.0)


@pytest.mark.parametrize("v_mps", [0.5, 5.0, 20.0, 33.0])
def test_equilibrium_gap_gives_zero_acceleration(v_mps: float) -> None:
    """f = 0 at equal speeds gives d = (s0 + v T) / sqrt(1 - (v / v0)^delta)."""
    gap_m = (P.s0_m + v_mps * P.T_s) / sqrt(1.0 - (v_mps / P.v0_mps) ** P.delta)
    assert f(gap_m, v_mps, v_mps) == pytest.approx(0.0, abs=1e-12)


def test_a_free_road_is_an_endless_gap_and_ends_at_the_desired_speed() -> None:
    assert f(nan, 12.0, nan) == pytest.approx(f(inf, 12.0, 12.0))
    assert f(nan, P.v0_mps, nan) == pytest.approx(0.0, abs=1e-12)
    assert idm(nan, 12.0, nan, P)[1] == idm(nan, 12.0, nan, P)[3] == 0.0


@pytest.mark.parametrize("gap_m", [GAP_FLOOR_M, 0.1, 0.0, -3.0])
def test_a_gap_below_the_floor_counts_as_the_floor(gap_m: float) -> None:
    value, df_dx, _, _ = idm(gap_m, 0.2, 1.0, IdmParams(s0_m=0.4))
    assert value == f(GAP_FLOOR_M, 0.2, 1.0, IdmParams(s0_m=0.4))
    assert df_dx == 0.0


def test_braking_is_held_at_what_tyres_can_do() -> None:
    assert idm(1.0, 30.0, 0.0, P) == (BRAKING_LIMIT_MPS2, 0.0, 0.0, 0.0)


def test_a_negative_speed_counts_as_standing() -> None:
    value, _, df_dv, df_dvl = idm(10.0, -2.0, 3.0, P)
    assert value == f(10.0, 0.0, 3.0)
    assert df_dv == df_dvl == 0.0


def test_gradient_is_that_of_the_function_limits_included() -> None:
    rng = np.random.default_rng(1)
    h = 1e-6
    for _ in range(300):
        gap_m, v, v_leader = rng.uniform(-2.0, 120.0), rng.uniform(-1.0, 35.0), rng.uniform(0.0, 35.0)
        corners = (gap_m - GAP_FLOOR_M, v, f(gap_m, v, v_leader) - BRAKING_LIMIT_MPS2)
        if min(map(abs, corners)) < 1e-3:
            continue
        _, df_dx, df_dv, df_dvl = idm(gap_m, v, v_leader, P)
        tolerance = {"rel": 1e-5, "abs": 1e-6}
        assert df_dx == pytest.approx(-(f(gap_m + h, v, v_leader) - f(gap_m - h, v, v_leader)) / (2 * h), **tolerance)
        assert df_dv == pytest.approx((f(gap_m, v + h, v_leader) - f(gap_m, v - h, v_leader)) / (2 * h), **tolerance)
        assert df_dvl == pytest.approx((f(gap_m, v, v_leader + h) - f(gap_m, v, v_leader - h)) / (2 * h), **tolerance)
