"""The detectors of a configuration: plausibility checks, motion model and pair tests. Their state is one bank row."""

from dataclasses import dataclass, replace

import numpy as np

from headway.core.consistency.pair_tests import PAIR_TESTS, PairTestParams, pair_test_params
from headway.core.estimation import registry
from headway.core.plausibility.limits import Limits
from headway.core.plausibility.state import PLAUSIBILITY
from headway.core.types.config import DetectorConfig

PAIR_TEST_SHARE = 0.5
"""Share of the alarm budget for the pair tests; the rest is for the motion model."""


@dataclass(frozen=True, slots=True)
class Detectors:
    """Everything that a verdict depends on beside the row and the reading."""

    model: registry.Model
    pair_test_params: PairTestParams
    limits: Limits
    dtype: np.dtype[np.void]
    """Row of the bank: `model` for the motion model, `pair_tests` and `plausibility`."""


def build_detectors(config: DetectorConfig) -> Detectors:
    """Return the detectors of `config`; KeyError for an unknown model."""
    model = registry.build(
        replace(config, alarm_budget_per_hour=(1.0 - PAIR_TEST_SHARE) * config.alarm_budget_per_hour)
    )
    return Detectors(
        model=model,
        pair_test_params=pair_test_params(PAIR_TEST_SHARE * config.alarm_budget_per_hour),
        limits=Limits(),
        dtype=np.dtype([("model", model.dtype), ("pair_tests", PAIR_TESTS), ("plausibility", PLAUSIBILITY)]),
    )
