"""Whatever is reported, the pair tests give finite results and keep a finite state."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, PAIR_TESTS, pair_test_params, step_pair_tests
from headway.core.types.records import READING

P = pair_test_params(budget_per_hour=1.0)
ROWS, LEADERS = np.arange(2), np.array([-1, 0])


def finite(record: np.ndarray) -> bool:
    dtype = record.dtype
    if dtype.names is None:
        return bool(np.isfinite(record).all())
    return all(finite(record[name]) for name in dtype.names)


def reported(rng: np.random.Generator, n: int, wild: float) -> np.ndarray:
    """READING (n, 2): random walks that now and then leap, uneven times, sensors and leaders that come and go."""
    readings = np.zeros((n, 2), READING)
    t_s = 1.6e9 + np.cumsum(rng.choice([0.05, 0.1, 0.1, 0.1, 0.6, 3.0], n))
    leaps = rng.random((n, 2)) < 0.05
    v_mps = np.clip(np.cumsum(rng.normal(0.0, 0.1, (n, 2)), axis=0) + 10.0 + leaps * wild, 0.0, 163.0)
    readings["t_s"] = t_s[:, None]
    readings["v_mps"] = v_mps
    readings["x_m"] = np.cumsum(0.1 * v_mps, axis=0) + leaps * wild + [20.0, 0.0]
    readings["leader_t_s"] = t_s[:, None] - rng.uniform(0.0, 1.0, (n, 1))
    readings["leader_t_s"][:, 0] = np.nan
    readings["leader_t_s"][rng.random(n) < 0.1, 1] = np.nan
    readings["leader_x_m"][:, 1] = readings["x_m"][:, 0]
    readings["leader_v_mps"][:, 1] = v_mps[:, 0]
    readings["leader_length_m"] = 5.0
    readings["range_m"] = np.where(rng.random((n, 2)) < 0.3, np.nan, rng.uniform(0.0, 300.0, (n, 2)))
    readings["range_rate_mps"] = np.where(rng.random((n, 2)) < 0.3, np.nan, rng.normal(0.0, wild + 0.1, (n, 2)))
    return readings


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1e6))
def test_state_and_verdicts_stay_finite(seed: int, wild: float) -> None:
    readings = reported(np.random.default_rng(seed), 600, wild)
    pair_tests, verdicts = np.zeros(2, PAIR_TESTS), np.zeros(2, PAIR_TEST_VERDICT)
    for k in range(readings.shape[0]):
        step_pair_tests(pair_tests, ROWS, LEADERS, readings[k], P, verdicts)
        assert finite(verdicts)
    assert finite(pair_tests)
