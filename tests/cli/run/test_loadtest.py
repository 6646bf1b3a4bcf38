"""Targets of a load: those that are meant for its size."""

from math import inf

import pytest

from headway.cli.run.loadtest import BUNDLE_TARGETS, FEW_TARGETS, SOAK_TARGETS, SURGE_TARGETS, Load, targets_for
from headway_loadtest.measure.report import Targets


@pytest.mark.parametrize(
    ("load", "targets"),
    [
        (Load(1, 5), FEW_TARGETS),
        (Load(250, 5), FEW_TARGETS),
        (Load(2_500, 5, rate_hz=1.0), FEW_TARGETS),
        (Load(100, 5, bundle=25), FEW_TARGETS),
        (Load(251, 5), Targets(p50_ms=2.0, p99_ms=5.0, service_cpu_us=40.0)),
        (Load(5_000, 5), Targets(p50_ms=3.0, p99_ms=8.0, service_cpu_us=14.0)),
        (Load(50_000, 5), Targets(p50_ms=5.0, p99_ms=15.0, service_cpu_us=11.0)),
        (Load(20_000, 5, bundle=25), BUNDLE_TARGETS),
        (Load(10, 5, rotate_s=30.0), SOAK_TARGETS),
        (Load(10, 5, rotate_s=inf, surge=5), SURGE_TARGETS),
    ],
)
def test_a_load_is_held_against_the_targets_for_its_size(load: Load, targets: Targets) -> None:
    assert targets_for(load) == targets
