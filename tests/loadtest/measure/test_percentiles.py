import numpy as np
import pytest

from headway_loadtest.measure.percentiles import measure, of_buckets


def test_percentiles_of_measurements():
    values_us = np.random.default_rng(1).permutation(np.arange(1, 100_001))
    found = measure(values_us.tolist())
    assert found is not None
    assert found.count == 100_000
    for value, expected_ms in ((found.p50, 50.0), (found.p99, 99.0), (found.p999, 99.9), (found.max, 100.0)):
        assert value == pytest.approx(expected_ms, rel=2e-3)


def test_early_and_absurd_measurements_are_kept_in_range():
    found = measure([-5.0, 0.2, 1e12])
    assert found is not None
    assert found.count == 3
    assert found.max == pytest.approx(600_000.0, rel=1e-3)


def test_nothing_measured_is_none():
    assert measure([]) is None
    assert of_buckets({}, {}) is None
    assert of_buckets({100.0: 3}, {100.0: 3}) is None


def test_buckets_gained_between_two_reports():
    before = {100.0: 1_000_000, 5000.0: 7}
    after = {100.0: 1_000_900, 1000.0: 90, 5000.0: 16, 20_000.0: 1}
    found = of_buckets(before, after)
    assert found is not None
    assert found.count == 1000
    assert (found.p50, found.p99, found.p999, found.max) == (0.1, 1.0, 5.0, 20.0)


def test_a_percentile_is_never_too_low():
    values_us = np.random.default_rng(2).exponential(3000.0, 20_000)
    edges_us = np.geomspace(10.0, 1e6, 400)
    buckets = {float(edges_us[i]): int(n) for i, n in enumerate(np.bincount(np.searchsorted(edges_us, values_us)))}
    found = of_buckets({}, buckets)
    assert found is not None
    for value, quantile in ((found.p50, 0.5), (found.p99, 0.99), (found.p999, 0.999)):
        exact_ms = np.quantile(values_us, quantile, method="inverted_cdf") / 1e3
        assert exact_ms <= value <= exact_ms * 1.03


def test_json_has_the_four_by_name():
    found = measure([1000.0])
    assert found is not None
    assert found.to_json() == pytest.approx({"p50": 1.0, "p99": 1.0, "p999": 1.0, "max": 1.0}, rel=1e-3)
