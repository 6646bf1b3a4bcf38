"""A verdict computed again from its evidence, through the same kernels as the first time."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from headway.core.consistency.pair_tests import PAIR_TEST_VERDICT, pair_verdicts, step_pair, substitute_rejected
from headway.core.pipeline.detectors import build_detectors
from headway.core.runtime import rows as banks
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Records
from headway.core.types.step_result import Evidence


@dataclass(frozen=True, slots=True)
class Replay:
    """What was said of each reading of the evidence, oldest first; the last one is the reading of the statement."""

    by_filter: Records
    """(n,) of VERDICT."""
    by_pair_tests: Records
    """(n,) of VERDICT: the tests between two cars. Who of the two is to blame, and how surely, is not in the evidence,
    for the rows of their neighbours have a say in it: `confidence` says nothing."""


def bank_row(checkpoint: bytes, config: DetectorConfig) -> Records:
    """Return the row of the bank that was written down as `checkpoint`.

    Raises
    ------
    ValueError
        The bytes are not a row of this model, as this version of the core keeps it.
    """
    dtype = build_detectors(config).dtype
    if len(checkpoint) != dtype.itemsize:
        raise ValueError(f"a checkpoint of {len(checkpoint)} bytes, where a row of this version has {dtype.itemsize}")
    row: Records = np.frombuffer(checkpoint, dtype)[0]
    return row


def replay(evidence: Evidence, config: DetectorConfig) -> Replay:
    """Judge every reading of the evidence again, beginning at its checkpoint."""
    detectors = build_detectors(config)
    model, readings = detectors.model, evidence.readings
    # Two rows, though one is used: the kernels have been compiled for banks, whose columns are apart in memory.
    bank = np.zeros(2, detectors.dtype)
    bank[0] = evidence.checkpoint
    row = np.zeros(1, np.int64)
    verdicts = banks.verdicts(readings.size)
    for k in range(readings.size):
        model.step_batch(bank["model"], row, readings[k : k + 1], model.params, verdicts[k : k + 1])
    pair_tests = np.zeros(readings.size, PAIR_TEST_VERDICT)
    _step_pair_tests(
        bank["pair_tests"],
        evidence.leaders,
        substitute_rejected(readings, verdicts),
        detectors.pair_test_params,
        pair_tests,
    )
    return Replay(verdicts, pair_verdicts(pair_tests, verdicts))


@njit(cache=True)
def _step_pair_tests(pair_tests: Any, leaders: Any, readings: Any, p: Any, verdicts: Any) -> None:
    """Take the readings one after the other through row 0 of `pair_tests`."""
    for i in range(readings.size):
        step_pair(pair_tests[0], leaders[i], readings[i], p, verdicts[i])
