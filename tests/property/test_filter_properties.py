"""Whatever comes in, P stays a covariance; and the order of rows in a batch means nothing."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.estimation.delayed_ekf import step_batch, step_row
from headway.core.estimation.registry import paper_dtype, paper_params
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig

ORDERS = {"ekf": 2, "aekf": 3}
DELAY_MAX_S = 5.0

interval_s = st.one_of(st.just(0.1), st.floats(1e-3, 6.0))
location_m = st.floats(-1e6, 1e6)
speed_mps = st.floats(-10.0, 100.0)
leader = st.none() | st.tuples(st.floats(0.0, 1.0), location_m, speed_mps, st.floats(1.0, 30.0))
messages = st.lists(st.tuples(interval_s, location_m, speed_mps, leader), min_size=2, max_size=40)


def batch(sent):
    made = readings(len(sent))
    t_s = 0.0
    for z, (interval, x_m, v_mps, ahead) in zip(made, sent, strict=True):
        t_s += interval
        z["t_s"], z["x_m"], z["v_mps"] = t_s, x_m, v_mps
        if ahead is not None:
            z["leader_t_s"] = t_s - ahead[0]
            z["leader_x_m"], z["leader_v_mps"], z["leader_length_m"] = ahead[1:]
    return made


@pytest.mark.parametrize("model", ["ekf", "aekf"])
@settings(max_examples=60, deadline=None)
@given(sent=messages, delay_s=st.sampled_from([0.0, 0.03, 0.5, 1.5, 5.0]), gate=st.sampled_from([0.5, 13.8, 1e12]))
def test_the_covariance_is_symmetric_positive_definite_and_finite(
    model: str, sent, delay_s: float, gate: float
) -> None:
    p = paper_params(DetectorConfig(delay_s=delay_s, delay_jitter_s=0.2, warming_readings=3))._replace(gate=gate)
    bank = np.zeros(1, paper_dtype(ORDERS[model], DELAY_MAX_S))
    for z in batch(sent):
        verdict = verdicts(1)
        step_row(bank[0], z, p, verdict[0])
        s, P = bank[0]["s"], bank[0]["P"]
        assert np.isfinite(s).all()
        assert np.isfinite(P).all()
        assert np.abs(P - P.T).max() <= 1e-12 * np.abs(P).max()
        assert np.linalg.eigvalsh(P).min() > -1e-12 * np.abs(P).max()
        assert verdict[0]["nis"] >= 0.0
        assert np.isfinite(verdict[0]["nis"])


@settings(max_examples=40, deadline=None)
@given(sent=messages, order=st.randoms(use_true_random=False))
def test_the_order_of_rows_in_a_batch_is_irrelevant(sent, order) -> None:
    p = paper_params(DetectorConfig(delay_s=0.5, warming_readings=0))
    read = batch(sent)
    count = len(read)
    rows = np.arange(count)
    shuffled = np.array(order.sample(range(count), count))
    banks = [np.zeros(count, paper_dtype(3, DELAY_MAX_S)) for _ in range(2)]
    for _ in range(3):
        out = [verdicts(count) for _ in range(2)]
        step_batch(banks[0], rows, read, p, out[0])
        step_batch(banks[1], rows[shuffled], read[shuffled], p, out[1])
        same(out[0][shuffled], out[1])
        read["t_s"] += 0.1
    same(*banks)


def same(left, right) -> None:
    for name in left.dtype.names:
        np.testing.assert_array_equal(left[name], right[name])
