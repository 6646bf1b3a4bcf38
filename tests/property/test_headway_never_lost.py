"""Whatever a vehicle sends, the model stays a set of probabilities and covariances, and finds back to the truth."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit

from headway.core.estimation.imm.modes import HEALTHY, SINGLE_FAULT_MODES
from headway.core.estimation.imm.state import PRUNE_DOUBLES_ABOVE
from headway.core.estimation.imm.step import headway_dtype, headway_params, step_row
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

CONFIG = DetectorConfig(alarm_budget_per_hour=0.1)
P, ROW = headway_params(CONFIG), headway_dtype(CONFIG.delay_s)
AFTER = 600
"""Correct readings: a minute, whose last ten seconds are checked. The noise adapts to garbage and then back."""
FALSE_ALARMS = 1
"""Among hundreds of drives there may be one with so many in its last ten seconds,"""
LONGEST = 26
"""and it ends after so many readings: the fault time-out is 2.5 s."""

interval_s = st.one_of(st.just(0.1), st.floats(1e-3, 6.0))
location_m = st.one_of(st.floats(-1e6, 1e6), st.floats(-5.0, 5.0))
speed_mps = st.one_of(st.floats(-10.0, 100.0), st.floats(9.0, 11.0))
leader = st.one_of(st.just((np.nan, np.nan, np.nan)), st.tuples(st.floats(-1.0, 1.0), location_m, speed_mps))
garbage = st.lists(st.tuples(interval_s, location_m, speed_mps, leader), min_size=1, max_size=80)
TRIANGLE = np.triu_indices(5)


@njit
def along(row, read, p, out):
    for k in range(read.size):
        step_row(row, read[k], p, out[k])


def batch(sent):
    made = readings(len(sent))
    made["t_s"] = np.cumsum([interval for interval, _, _, _ in sent])
    made["x_m"] = [x_m for _, x_m, _, _ in sent]
    made["v_mps"] = [v_mps for _, _, v_mps, _ in sent]
    made["leader_t_s"] = made["t_s"] + [age_s for _, _, _, (age_s, _, _) in sent]
    made["leader_x_m"] = [x_m for _, _, _, (_, x_m, _) in sent]
    made["leader_v_mps"] = [v_mps for _, _, _, (_, _, v_mps) in sent]
    made["leader_length_m"] = 5.0
    return made


@settings(max_examples=150, deadline=None)
@given(sent=garbage)
def test_mode_probabilities_are_probabilities_and_covariances_positive(sent) -> None:
    bank = np.zeros(1, ROW)
    for z in batch(sent):
        verdict = verdicts(1)
        step_row(bank[0], z, P, verdict[0])
        row = bank[0]
        assert abs(row["mode_probability"].sum() - 1.0) < 1e-8
        assert row["mode_probability"].min() > 0.0
        assert np.isfinite(row["single"]).all()
        assert np.isfinite(row["double"]).all()
        doubles = row["double"].T if row["mode_probability"][HEALTHY] <= PRUNE_DOUBLES_ABOVE else []
        for m in [*row["single"].T[:SINGLE_FAULT_MODES], *doubles]:
            cov = np.zeros((5, 5))
            cov[TRIANGLE] = m[5:]
            cov = cov + np.triu(cov, 1).T
            assert np.linalg.eigvalsh(cov[:3, :3]).min() > -1e-9 * max(1.0, np.abs(cov[:3, :3]).max())
            assert min(cov[0, 0], cov[1, 1], cov[2, 2]) > 0.0
        for name in ("nis", "statistic", "gate", "p_value", "x_m", "v_mps", "x_std_m", "v_std_mps", "confidence"):
            assert np.isfinite(verdict[0][name]), name
        assert verdict[0]["nis"] >= 0.0
        assert 0.0 <= verdict[0]["p_value"] <= 1.0
        assert 0.0 <= verdict[0]["confidence"] <= 1.0


@settings(max_examples=150, deadline=None)
@given(sent=garbage, seed=st.integers(0, 1000))
def test_after_any_garbage_clean_readings_recover_the_filter(sent, seed: int) -> None:
    rng = np.random.default_rng(seed)
    bank = np.zeros(1, ROW)
    read = batch(sent)
    along(bank[0], read, P, verdicts(len(read)))
    correct = readings(AFTER)
    since = 0.1 * np.arange(1, AFTER + 1)
    correct["t_s"] = read["t_s"][-1] + since
    correct["x_m"] = 100.0 + 10.0 * since + rng.normal(0.0, 0.01, AFTER)
    correct["v_mps"] = 10.0 + rng.normal(0.0, 0.01, AFTER)
    out = verdicts(AFTER)
    along(bank[0], correct, P, out)
    at = np.flatnonzero(out["anomalous"][-100:])
    assert (np.diff(at, prepend=-10) > 1).sum() <= FALSE_ALARMS
    assert len(at) <= LONGEST
    assert abs(out["x_m"][-1] - (100.0 + 10.0 * since[-1])) < 0.5
    assert abs(out["v_mps"][-1] - 10.0) < 0.5
