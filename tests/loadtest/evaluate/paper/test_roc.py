"""The ROC is fair: 1 for a perfect statistic, 1/2 for chance, and it closes at both ends."""

import numpy as np
import pytest

from headway_loadtest.evaluate.paper.roc import closed_loop, thresholds


def auc(statistic, anomalous) -> float:
    return closed_loop(lambda gate: statistic > gate, anomalous, thresholds(statistic)).auc


def test_a_perfect_statistic_has_area_one() -> None:
    anomalous = np.arange(1000) % 20 == 0
    assert auc(anomalous + np.linspace(0.0, 0.5, 1000), anomalous) == pytest.approx(1.0, abs=1e-3)


def test_a_reversed_statistic_has_area_zero() -> None:
    anomalous = np.arange(1000) % 20 == 0
    assert auc(-1.0 * anomalous + np.linspace(0.0, 0.5, 1000), anomalous) == pytest.approx(0.0, abs=0.01)


def test_chance_has_area_one_half() -> None:
    rng = np.random.default_rng(1)
    assert auc(rng.random(40_000), rng.random(40_000) < 0.2) == pytest.approx(0.5, abs=0.01)


def test_a_statistic_that_never_changes_is_chance() -> None:
    assert auc(np.ones(100), np.arange(100) < 10) == pytest.approx(0.5)


def test_it_agrees_with_the_rank_statistic() -> None:
    """AUC is the chance that an anomalous sample scores above a normal one (Mann, Whitney 1947)."""
    rng = np.random.default_rng(2)
    anomalous = rng.random(3000) < 0.1
    statistic = rng.normal(size=3000) + 1.5 * anomalous
    ranks = np.argsort(np.argsort(statistic)) + 1
    n1, n0 = anomalous.sum(), (~anomalous).sum()
    assert auc(statistic, anomalous) == pytest.approx(
        (ranks[anomalous].sum() - n1 * (n1 + 1) / 2) / (n1 * n0), abs=3e-3
    )


def test_a_closed_loop_may_go_back_and_forth_and_still_gives_a_curve() -> None:
    anomalous = np.arange(100) < 20
    rng = np.random.default_rng(3)
    found = closed_loop(lambda gate: rng.random(100) < 1.0 - gate, anomalous, np.linspace(0.0, 1.0, 50))
    assert np.all(np.diff(found.fpr) >= 0.0)
    assert (found.fpr[0], found.tpr[0], found.fpr[-1], found.tpr[-1]) == (0.0, 0.0, 1.0, 1.0)


@pytest.mark.parametrize("anomalous", [np.zeros(5, bool), np.ones(5, bool)])
def test_one_class_alone_is_refused(anomalous) -> None:
    with pytest.raises(ValueError, match="anomalous and normal"):
        closed_loop(np.full(5, 2.0).__gt__, anomalous, np.array([1.0]))
