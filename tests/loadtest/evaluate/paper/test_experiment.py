"""The experiment in small, held fast: a cell that moves is seen."""

import json
from itertools import product
from pathlib import Path

import numpy as np
import pytest

from headway_loadtest.evaluate.paper.experiment import (
    DELAYS_S,
    MODELS,
    PRINTED_AUC,
    SEVERITIES,
    PaperResult,
    Protocol,
    run_paper,
)
from headway_loadtest.evaluate.paper.leader import HEAD_START_M, Leader, read_leader
from headway_loadtest.evaluate.paper.loop import History, Recovery

GOLDEN: dict[Recovery, dict[str, tuple[tuple[float, ...], ...]]] = {
    Recovery.GROUND_TRUTH: {
        "ekf": ((0.9725, 0.9243, 0.8627), (0.9608, 0.9118, 0.7975), (0.8932, 0.8008, 0.7017)),
        "aekf": ((0.9595, 0.9604, 0.8803), (0.9360, 0.9402, 0.8313), (0.8542, 0.8698, 0.7212)),
    },
    Recovery.PREDICTION: {
        "ekf": ((0.9183, 0.8240, 0.7616), (0.8962, 0.7832, 0.7504), (0.7962, 0.7237, 0.7151)),
        "aekf": ((0.9227, 0.8456, 0.6479), (0.8792, 0.8245, 0.6273), (0.7956, 0.7481, 0.5459)),
    },
}
"""AUC by recovery and model; severity down, delay across."""


def cells(result: PaperResult) -> dict[tuple[str, float, float], float]:
    return {(row.model, row.delay_s, row.severity): row.auc for row in result.table1}


@pytest.mark.parametrize("recovery", list(Recovery))
def test_no_cell_moves(leader: Leader, recovery: Recovery) -> None:
    result = run_paper(leader, Protocol(runs=2, recovery=recovery))
    found = cells(result)
    for model in MODELS:
        table = [[found[model, delay_s, severity] for delay_s in DELAYS_S] for severity in SEVERITIES]
        np.testing.assert_allclose(table, GOLDEN[recovery][model], atol=2e-3)


def test_equal_arguments_give_equal_results_in_other_processes(leader: Leader) -> None:
    protocol = Protocol(runs=1, history=History.BUFFERS, delay_jitter_s=0.1)
    assert run_paper(leader, protocol, processes=2).to_json() == run_paper(leader, protocol).to_json()


def test_progress_counts_every_part(leader: Leader) -> None:
    seen: list[tuple[int, int]] = []
    run_paper(leader, Protocol(runs=1), progress=lambda done, total: seen.append((done, total)))
    assert seen == [(1, 3), (2, 3), (3, 3)]


def test_the_result_says_what_was_run(leader: Leader) -> None:
    result = json.loads(json.dumps(run_paper(leader, Protocol(runs=2, seed=40)).to_json(), allow_nan=False))
    assert result["seeds"] == [40, 41]
    assert (result["recovery"], result["history"]) == ("ground-truth", "constant")
    assert len(result["table1"]) == 18
    assert len(result["table2"]) == 6
    assert [(row["delay_s"], row["severity"]) for row in result["headway"]] == list(product(DELAYS_S, SEVERITIES))
    for row in result["headway"]:
        assert row["printed"] == PRINTED_AUC["aekf", row["delay_s"], row["severity"]]
    for row in result["table1"]:
        assert row.keys() == {"model", "delay_s", "severity", "auc", "auc_std", "p_value", "printed"}
        assert 0.4 < row["auc"] < 1.0
    printed = sum(abs(row["auc"] - row["printed"]) for row in result["table1"]) / 18
    assert result["mean_absolute_deviation"] == pytest.approx(printed)


def test_one_run_has_no_spread_and_no_t_test(leader: Leader) -> None:
    row = run_paper(leader, Protocol(runs=1)).table1[0]
    assert row.auc_std is None
    assert row.p_value is None


def test_the_published_table_is_met_on_the_shared_drive(shared_data: Path) -> None:
    """A part of it, and few runs: the whole is for `headway evaluate paper`."""
    path = shared_data / "paper" / "spmd_leader_train.csv"
    if not path.is_file():
        pytest.skip(f"no leader's drive at {path}")
    whole = read_leader(path)
    part = Leader(whole.x_m[2500:3500] - whole.x_m[2500] + HEAD_START_M, whole.v_mps[2500:3500])
    result = run_paper(part, Protocol(runs=4))
    assert result.mean_absolute_deviation < 0.05
    found = cells(result)
    better = [
        found["aekf", delay_s, severity] > found["ekf", delay_s, severity]
        for delay_s in DELAYS_S[1:]
        for severity in SEVERITIES
    ]
    assert all(better)
