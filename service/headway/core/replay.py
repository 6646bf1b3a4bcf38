"""The second door of the core: a verdict computed again from its evidence, through the same kernels."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, pair_verdicts, step_pair, substitute_rejected
from headway.core.pipeline.detectors import build_detectors
from headway.core.plausibility.checks import check_readings, combine
from headway.core.runtime import rows as banks
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Records
from headway.core.types.step_result import Evidence


@dataclass(frozen=True, slots=True)
class Replay:
    """The verdicts of each reading of the evidence, oldest first; the last one belongs to the event update."""

    by_filter: Records
    """(n,) of VERDICT."""
    by_pair_tests: Records
    """(n,) of VERDICT, by the pair tests. The suspect depends on the rows of the neighbours, which are not part of the
    evidence; so `confidence` has no meaning."""


def bank_row(checkpoint: bytes, config: DetectorConfig) -> Records:
    """Return the bank row that is stored as `checkpoint`.

    Raises
    ------
    ValueError
        The bytes are not a row of this model in this version of the core.
    """
    dtype = build_detectors(config).dtype
    if len(checkpoint) != dtype.itemsize:
        raise ValueError(f"a checkpoint of {len(checkpoint)} bytes, where a row of this version has {dtype.itemsize}")
    row: Records = np.frombuffer(checkpoint, dtype)[0]
    return row


def replay(evidence: Evidence, config: DetectorConfig) -> Replay:
    """Compute the verdicts of all readings of the evidence, from its checkpoint on."""
    detectors = build_detectors(config)
    model, readings = detectors.model, evidence.readings
    # Two rows, although one is used: the kernels are compiled for banks, whose columns are strided in memory.
    bank = np.zeros(2, detectors.dtype)
    bank[0] = evidence.checkpoint
    row = np.zeros(1, np.int64)
    verdicts = banks.verdicts(readings.size)
    for k in range(readings.size):
        of = slice(k, k + 1)
        check_readings(bank["plausibility"], row, readings[of], detectors.limits, verdicts[of])
        model.step_batch(bank["model"], row, readings[of], model.params, verdicts[of])
        combine(bank["plausibility"], row, detectors.limits, verdicts[of])
    pair_tests = np.zeros(readings.size, PAIR_TEST_VERDICT)
    _step_pair_tests(
        bank["pair_tests"],
        evidence.leaders,
        substitute_rejected(readings, verdicts),
        detectors.pair_test_params,
        pair_tests,
    )
    return Replay(verdicts, pair_verdicts(pair_tests, verdicts))


@njit(cache=True, error_model="numpy")
def _step_pair_tests(pair_tests: Any, leaders: Any, readings: Any, p: Any, verdicts: Any) -> None:
    """Step row 0 of `pair_tests` through the readings."""
    for i in range(readings.size):
        step_pair(pair_tests[0], leaders[i], readings[i], p, verdicts[i])
