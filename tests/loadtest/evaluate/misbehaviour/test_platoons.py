import numpy as np

from headway_loadtest.evaluate.misbehaviour.platoons import Platoon, chain, synthetic

T_S = 0.1 * np.arange(100)


def pair(group: str, ahead_m: float, seconds: float = 10.0) -> Platoon:
    """Two cars at 10 m/s, 20 m apart, the first `ahead_m` down the road."""
    t_s = 0.1 * np.arange(round(seconds * 10))
    x_m = np.stack([10.0 * t_s + ahead_m, 10.0 * t_s + ahead_m - 20.0], axis=1)
    return Platoon(group, t_s, x_m, np.full(x_m.shape, 10.0), np.array([5.0, 5.0]))


def test_a_pair_right_behind_another_makes_four() -> None:
    (four,) = chain([pair("a", 0.0), pair("a", 45.0)])
    assert four.group == "a-platoon"
    assert four.x_m[0].tolist() == [45.0, 25.0, 0.0, -20.0]


def test_pairs_that_did_not_drive_together_stay_apart() -> None:
    assert chain([pair("a", 0.0), pair("b", 45.0)]) == []
    assert chain([pair("a", 0.0), pair("a", 45.0, seconds=11.0)]) == []
    assert chain([pair("a", 0.0), pair("a", 300.0)]) == []
    assert chain([pair("a", 0.0), pair("a", 10.0)]) == []


def test_pairs_that_share_a_car_or_leave_one_out_are_no_platoon() -> None:
    first, shares, next_but_one = pair("a", 100.0), pair("a", 80.0), pair("a", 40.0)
    assert chain([first, shares]) == []
    assert chain([first, next_but_one]) == []
    (four,) = chain([first, shares, pair("a", 60.0)])
    assert four.x_m[0].tolist() == [100.0, 80.0, 60.0, 40.0]


def test_synthetic_drivers_neither_collide_nor_drive_backwards() -> None:
    for seed in range(5):
        four = synthetic(np.random.default_rng(seed), 120.0)
        assert (-np.diff(four.x_m, axis=1) > four.length_m[0]).all()
        assert (four.v_mps >= 0.0).all()
        assert four.v_mps[:, 3].std() > 1.0
