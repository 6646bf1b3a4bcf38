"""What is the experiment's and not the service's: the oracle, and a history held constant."""

import numpy as np
import pytest

from headway.core.estimation.delay_buffers import own_at
from headway.core.estimation.delayed_ekf import WORKSPACE, innovate, predict
from headway.core.estimation.registry import paper_dtype
from headway.core.runtime.rows import verdicts
from headway_loadtest.evaluate.paper.follower import corrupt, drive
from headway_loadtest.evaluate.paper.leader import Leader
from headway_loadtest.evaluate.paper.loop import (
    DELAY_MAX_S,
    ORDERS,
    History,
    Recovery,
    flatten_history,
    params,
    run,
    run_closed_loop,
    substitute_truth,
)


def row_after(leader: Leader, model: str, samples: int):
    """The bank row after some clean readings at tau = 0.5 s."""
    p = params(model, 0.5)
    follower = drive(leader, 0.5, 0.0, seed=1)
    bank = np.zeros(1, paper_dtype(ORDERS[model], DELAY_MAX_S))
    read = follower.readings[:samples]
    run_closed_loop(bank[0], read, p, follower.x_m, follower.v_mps, False, False, verdicts(samples))
    return bank, p


@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_the_oracle_leaves_no_innovation_to_the_truth(leader: Leader, model: str) -> None:
    bank, p = row_after(leader, model, 100)
    predict(bank[0], 10.1, p, np.zeros(1, WORKSPACE)[0])
    before = bank[0]["P"].copy()
    substitute_truth(bank[0], 70.0, 12.0, p, np.zeros(1, WORKSPACE)[0])
    nu_x, nu_v, *_ = innovate(bank[0], 70.0, 12.0, p)
    assert (nu_x, nu_v) == pytest.approx((0.0, 0.0), abs=1e-12)
    assert np.trace(bank[0]["P"]) < np.trace(before)


@pytest.mark.parametrize("model", ["ekf", "aekf"])
def test_a_constant_history_is_the_present_wherever_the_delay_looks(leader: Leader, model: str) -> None:
    bank, p = row_after(leader, model, 100)
    n = ORDERS[model]
    flatten_history(bank[0], p.delay_s)
    s, P = np.empty(n), np.empty((n, n))
    for age_s in (0.0, 0.1, 0.5):
        own_at(bank[0], bank[0]["t_s"] - age_s, s, P)
        np.testing.assert_allclose(s, bank[0]["s"], rtol=1e-14)
        np.testing.assert_allclose(P, bank[0]["P"], rtol=1e-14)


def test_the_histories_agree_without_delay_and_differ_with_it(leader: Leader) -> None:
    for delay_s, alike in ((0.0, True), (0.5, False)):
        follower = drive(leader, delay_s, 0.0, seed=1)
        p = params("aekf", delay_s)
        nis = [run("aekf", p, follower, follower.readings, Recovery.PREDICTION, h)["nis"] for h in History]
        assert np.array_equal(*nis) is alike


def test_only_the_oracle_puts_the_truth_in_place_of_a_rejected_reading(leader: Leader) -> None:
    follower = drive(leader, 0.5, 0.0, seed=1)
    corrupted = corrupt(follower, 1.0, seed=1)
    p = params("aekf", 0.5)._replace(gate=1.0)
    for recovery in Recovery:
        results = run("aekf", p, follower, corrupted.readings, recovery, History.CONSTANT)
        rejected = results["anomalous"]
        assert rejected.any()
        is_true = np.array_equal(results["x_m"][rejected], follower.x_m[rejected])
        assert is_true is (recovery is Recovery.GROUND_TRUTH)


def test_the_oracle_never_needs_to_begin_anew_and_the_service_does(leader: Leader) -> None:
    follower = drive(leader, 0.5, 0.0, seed=1)
    p = params("aekf", 0.5)._replace(gate=0.0)
    restarted = {
        recovery: run("aekf", p, follower, follower.readings, recovery, History.CONSTANT)["restarted"].sum()
        for recovery in Recovery
    }
    assert restarted[Recovery.GROUND_TRUTH] == 0
    assert restarted[Recovery.PREDICTION] == (len(follower.readings) - 1) // p.rejections_max
