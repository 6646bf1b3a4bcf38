"""The simulated follower as documented: IDM, a delayed leader, a biased position, and no knowledge of the future."""

import numpy as np
import pytest

from headway.core.estimation.car_following import IdmParams, idm
from headway_loadtest.evaluate.paper.follower import LENGTH_M, READING_STD, corrupt, drive, follow
from headway_loadtest.evaluate.paper.leader import INTERVAL_S, Leader


def test_without_delay_the_follower_obeys_the_idm_and_has_no_speed_bias(leader: Leader) -> None:
    follower = drive(leader, 0.0, 0.0, seed=1)
    assert (follower.x_m[0], follower.v_mps[0]) == (5.0, 1.0)
    np.testing.assert_allclose(np.diff(follower.x_m), INTERVAL_S * follower.v_mps[1:], atol=1e-12)
    for k in (0, 50, 300):
        f = idm(leader.x_m[k] - follower.x_m[k] - LENGTH_M, follower.v_mps[k], leader.v_mps[k], IdmParams())[0]
        assert follower.v_mps[k + 1] == pytest.approx(max(0.0, follower.v_mps[k] + INTERVAL_S * f))


def test_with_delay_the_position_moves_by_the_random_acceleration(leader: Leader) -> None:
    follower = drive(leader, 1.5, 0.0, seed=1)
    speed_bias_mps = np.diff(follower.x_m) / INTERVAL_S - follower.v_mps[1:]
    assert speed_bias_mps.mean() / 1.5 == pytest.approx(-0.65, abs=0.04)
    assert speed_bias_mps.std() / 1.5 == pytest.approx(0.25, abs=0.03)


@pytest.mark.parametrize(("delay_s", "late"), [(0.0, 0), (0.5, 5), (1.5, 15)])
def test_the_leader_is_whole_samples_late(leader: Leader, delay_s: float, late: int) -> None:
    changed = Leader(leader.x_m, leader.v_mps.copy())
    changed.v_mps[100] += 1.0
    before, after = (drive(each, delay_s, 0.0, seed=1).v_mps for each in (leader, changed))
    assert np.flatnonzero(before != after)[0] == 100 + late + 1


def test_a_stochastic_delay_never_lets_him_hear_the_future(leader: Leader) -> None:
    changed = Leader(leader.x_m, leader.v_mps.copy())
    changed.v_mps[100:] += 1.0
    before, after = (drive(each, 0.0, 0.3, seed=1).v_mps for each in (leader, changed))
    assert np.flatnonzero(before != after)[0] > 100
    assert np.any(before != drive(leader, 0.0, 0.0, seed=1).v_mps)


def test_he_never_drives_backwards(leader: Leader) -> None:
    n = len(leader.x_m)
    wall = np.full(n, 30.0)
    _, v_mps = follow(wall, np.zeros(n), np.zeros(n), np.zeros(n), IdmParams())
    assert v_mps.min() >= 0.0


def test_his_readings_carry_a_hundredth_of_noise_and_the_leaders_sample(leader: Leader) -> None:
    follower = drive(leader, 0.5, 0.0, seed=1)
    for read, truth in (("x_m", follower.x_m), ("v_mps", follower.v_mps)):
        assert np.std(follower.readings[read] - truth) == pytest.approx(READING_STD, rel=0.1)
    np.testing.assert_array_equal(follower.readings["leader_x_m"], leader.x_m)
    np.testing.assert_array_equal(follower.readings["t_s"], follower.readings["leader_t_s"])


def test_no_drive_is_without_an_event(leader: Leader) -> None:
    follower = drive(Leader(leader.x_m[:50], leader.v_mps[:50]), 0.0, 0.0, seed=1)
    assert all(corrupt(follower, 1.0, seed).anomalous.any() for seed in range(50))


def test_severity_moves_the_size_of_events_and_not_their_place(leader: Leader) -> None:
    follower = drive(leader, 0.5, 0.0, seed=1)
    large, small = (corrupt(follower, severity, seed=3) for severity in (1.0, 0.1))
    np.testing.assert_array_equal(large.anomalous, small.anomalous)
    assert 0.0 < large.anomalous.mean() < 0.3
    moved = np.abs(large.readings["v_mps"] - follower.readings["v_mps"])
    assert moved.max() > np.abs(small.readings["v_mps"] - follower.readings["v_mps"]).max() > 0.0
    assert not moved[~large.anomalous].any()
