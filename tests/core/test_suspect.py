import numpy as np
import pytest

from headway.core.suspect import CAP, HOLD_S, WITNESS, bear_witness, follower_log_odds

T_S = 1000.0


def platoon() -> np.ndarray:
    """Four cars, the first ahead; nobody has spoken yet."""
    return np.zeros(4, WITNESS)


def speak(cars: np.ndarray, statistics: dict[int, float], t_s: float = T_S) -> None:
    """Each follower's statistic against the car ahead of it."""
    for follower, statistic in statistics.items():
        bear_witness(cars[follower], cars[follower - 1], statistic, t_s)


def named(cars: np.ndarray, follower: int, lean: float = 0.0, t_s: float = T_S) -> int:
    odds = follower_log_odds(cars[follower], cars[follower - 1], lean, t_s)
    return follower if odds > 0.0 else follower - 1


@pytest.mark.parametrize("liar", [0, 1, 2, 3])
def test_every_disturbed_pair_of_four_names_the_liar(liar: int) -> None:
    cars = platoon()
    speak(cars, {follower: 7.0 if liar in (follower, follower - 1) else 1.0 for follower in (1, 2, 3)})
    for follower in {liar, liar + 1} & {1, 2, 3}:
        assert named(cars, follower) == liar


def test_a_pair_alone_is_decided_by_whose_motion_was_unusual() -> None:
    cars = platoon()[:2]
    speak(cars, {1: 6.0})
    assert follower_log_odds(cars[1], cars[0], 0.0, T_S) == 0.0
    assert named(cars, 1, lean=2.0) == 1
    assert named(cars, 1, lean=-2.0) == 0


def test_a_witness_who_is_not_there_says_nothing() -> None:
    """One witness, behind the follower: mu z - mu^2 / 2."""
    cars = platoon()[:3]
    speak(cars, {1: 6.0, 2: 4.0})
    assert follower_log_odds(cars[1], cars[0], 0.0, T_S) == pytest.approx(6.0 * 4.0 - 18.0)


def test_a_loud_witness_outweighs_what_the_pair_alone_suggests() -> None:
    cars = platoon()
    speak(cars, {1: 6.0, 2: 6.0, 3: 0.0})
    assert named(cars, 2, lean=10.0) == 1


def test_one_statement_never_counts_for_more_than_its_cap() -> None:
    cars = platoon()
    speak(cars, {1: 1e9, 2: 1e9, 3: 1e9})
    assert abs(follower_log_odds(cars[2], cars[1], 1e9, T_S)) <= 1.5 * CAP**2


def test_a_statement_is_forgotten() -> None:
    cars = platoon()
    speak(cars, {1: 6.0})
    speak(cars, {2: 6.0}, T_S + 0.5)
    assert named(cars, 2, lean=1.0, t_s=T_S + 0.5) == 1
    later = T_S + 2.0 * HOLD_S
    speak(cars, {2: 6.0}, later)
    assert named(cars, 2, lean=1.0, t_s=later) == 2
