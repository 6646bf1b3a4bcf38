from pathlib import Path

import numpy as np
import pytest

from headway.core.consistency.pair_tests import pair_test_params
from headway_loadtest.evaluate.misbehaviour.experiment import measure, onsets, readings_of, run_misbehaviour
from headway_loadtest.evaluate.misbehaviour.platoons import Platoon, synthetic


@pytest.fixture(scope="module")
def rows() -> dict[tuple[str, bool], dict]:
    drives = [synthetic(np.random.default_rng(seed), 150.0) for seed in (1, 2)]
    p = pair_test_params(1.0)
    return {
        (row["injection"], with_range): row
        for with_range in (False, True)
        for row in measure("made", drives, with_range, 1, 0, p)
    }


def test_range_exposes_drag_and_names_the_car(rows: dict) -> None:
    assert rows["drag", True]["recall_at_budget"] > 0.95
    assert rows["drag", True]["suspect_correct"] > 0.95
    assert rows["drag", False]["recall_at_budget"] < 0.2


def test_the_response_alone_finds_feigned_brakes(rows: dict) -> None:
    row = rows["feigned-brake", False]
    assert row["lies"] > 100
    assert row["recall_at_2pct_windows"] > 0.9
    assert row["suspect_correct"] > 0.9
    assert abs(row["confidence_at_onset"] - row["suspect_correct_at_onset"]) < 0.15
    assert row["detection_delay_s"] < 4.0


def test_same_seed_same_rows() -> None:
    drives, p = [synthetic(np.random.default_rng(3), 80.0)], pair_test_params(1.0)
    assert list(measure("made", drives, False, 1, 5, p)) == list(measure("made", drives, False, 1, 5, p))


def test_a_drive_too_short_to_learn_from_gives_no_numbers() -> None:
    drives = [synthetic(np.random.default_rng(4), 30.0)]
    assert all(
        row["lies"] == 0 and row["recall_at_budget"] is None
        for row in measure("made", drives, False, 1, 0, pair_test_params(1.0))
    )


def test_alarms_close_together_are_one() -> None:
    alarmed = np.zeros(300, bool)
    alarmed[[10, 11, 40, 200]] = True
    assert onsets(alarmed) == 2
    assert onsets(np.zeros(10, bool)) == 0


def test_the_follower_hears_what_the_leader_tells() -> None:
    truth: Platoon = synthetic(np.random.default_rng(5), 10.0)
    readings = readings_of(np.random.default_rng(0), truth, with_range=False)
    assert (readings["leader_x_m"][:, 1:] == readings["x_m"][:, :-1]).all()
    assert np.isnan(readings["leader_t_s"][:, 0]).all()
    assert np.isnan(readings["range_m"]).all()


def test_real_pairs(shared_data: Path) -> None:
    """Feigned brakes among drivers, what a range exposes, and the suspect in real platoons without it."""
    paths = [path for name in ("jiang", "napoli") for path in sorted((shared_data / "pairs" / name).glob("*.csv"))]
    rows = {(row["set"], row["injection"], row["with_range"]): row for row in run_misbehaviour(paths, runs=1, seed=0)}
    assert rows["jiang", "feigned-brake", False]["recall_at_2pct_windows"] >= 0.97
    assert rows["napoli", "feigned-brake", False]["recall_at_2pct_windows"] >= 0.95
    for name in ("jiang", "napoli", "napoli-platoon"):
        assert rows[name, "drag", True]["recall_at_budget"] >= 0.95
    for kind in ("feigned-brake", "replay", "freeze"):
        assert rows["napoli-platoon", kind, False]["suspect_correct"] >= 0.9
        assert rows["napoli-platoon", kind, True]["suspect_correct"] >= 0.98
    # An onset has a witness already, so its first suspect is as right as its last.
    assert rows["napoli-platoon", "feigned-brake", False]["suspect_correct_at_onset"] >= 0.9
