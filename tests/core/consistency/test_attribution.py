from math import exp

import numpy as np
import pytest

from headway.core.consistency.attribution import (
    FADE_S,
    FAULT_LOG_ODDS,
    LOG_LIKELIHOOD_RATIO_MAX,
    LOG_ODDS_MIN,
    SURPRISE_MAX,
    accumulate,
    decayed,
    follower_log_odds,
    is_recent,
)

T_S = 1000.0
CARS = 4


def pair_faults() -> np.ndarray:
    """The pairs of four vehicles, by follower, without a reading; the first vehicle has no leader."""
    return np.zeros(CARS + 1, FAULT_LOG_ODDS)


def accumulate_for(pairs: np.ndarray, ratios: dict[int, float], seconds: float = 4.0, t_s: float = T_S) -> None:
    """Steps at 2.5 Hz, each overlapping with four others, until `t_s`."""
    for k in range(round(seconds * 2.5)):
        for follower, log_likelihood_ratio in ratios.items():
            accumulate(pairs[follower], log_likelihood_ratio, 0.2, t_s - seconds + 0.4 * (k + 1))


def log_odds(
    pairs: np.ndarray, follower: int, follower_surprise: float = 0.0, leader_surprise: float = 0.0, t_s: float = T_S
) -> float:
    return follower_log_odds(pairs[follower + 1], pairs[follower - 1], follower_surprise, leader_surprise, t_s)


@pytest.mark.parametrize("faulty", range(CARS))
def test_each_inconsistent_pair_of_four_names_the_faulty_vehicle(faulty: int) -> None:
    pairs = pair_faults()
    accumulate_for(pairs, {follower: 4.0 if faulty in (follower, follower - 1) else -1.0 for follower in (1, 2, 3)})
    for follower in {faulty, faulty + 1} & {1, 2, 3}:
        assert (log_odds(pairs, follower) > 0.0) == (follower == faulty)


def test_a_pair_alone_is_attributed_by_motion_surprise() -> None:
    pairs = pair_faults()
    assert log_odds(pairs, 1) == 0.0
    assert log_odds(pairs, 1, follower_surprise=2.0, leader_surprise=0.5) == 1.5
    assert log_odds(pairs, 1, follower_surprise=0.5, leader_surprise=2.0) == -1.5
    assert log_odds(pairs, 1, follower_surprise=1e9) == SURPRISE_MAX == -log_odds(pairs, 1, leader_surprise=1e9)


def test_a_leader_that_responds_to_its_own_leader_is_cleared() -> None:
    pairs = pair_faults()
    accumulate_for(pairs, {1: -1.0})
    assert log_odds(pairs, 2, leader_surprise=9.0) == -decayed(pairs[1]["log_odds"], T_S, T_S) > 0.0


def test_a_missing_neighbour_contributes_nothing() -> None:
    pairs = pair_faults()
    accumulate_for(pairs, {3: 5.0})
    assert log_odds(pairs, 2) == pytest.approx(pairs[3]["log_odds"])
    assert log_odds(pairs, 2, t_s=T_S + FADE_S + 0.1) == 0.0


def test_doubt_adds_up_over_seconds_and_fades() -> None:
    pairs = pair_faults()
    accumulate_for(pairs, {1: 1.0}, seconds=20.0)
    assert pairs[1]["log_odds"] == pytest.approx(0.2 * (1.0 - exp(-20.0 / FADE_S)) / (1.0 - exp(-0.4 / FADE_S)))
    assert decayed(pairs[1]["log_odds"], pairs[1]["t_s"], T_S + FADE_S) == pytest.approx(pairs[1]["log_odds"] / np.e)
    assert is_recent(pairs[1], T_S + FADE_S)
    assert not is_recent(pairs[2], T_S)


def test_long_calm_is_worth_no_more_than_a_few_seconds_of_it() -> None:
    pairs = pair_faults()
    accumulate_for(pairs, {1: -6.0}, seconds=600.0)
    assert pairs[1]["log_odds"] == LOG_ODDS_MIN
    accumulate_for(pairs, {1: 4.0}, t_s=T_S + 4.0)
    assert pairs[1]["log_odds"] > 0.0


def test_no_reading_counts_for_more_than_its_cap() -> None:
    pairs = pair_faults()
    accumulate(pairs[1], 1e300, 1.0, T_S)
    assert pairs[1]["log_odds"] == LOG_LIKELIHOOD_RATIO_MAX
