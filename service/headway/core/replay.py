"""A verdict computed again from its evidence, through the same kernels as the first time."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import njit

from headway.core.consistency.pair_tests import LINK_VERDICT, link_said, standing, step_pair
from headway.core.pipeline.detectors import judges
from headway.core.runtime import rows as banks
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Records
from headway.core.types.step_result import Evidence


@dataclass(frozen=True, slots=True)
class Replay:
    """What was said of each reading of the evidence, oldest first; the last one is the reading of the statement."""

    by_filter: Records
    """(n,) of VERDICT."""
    by_link: Records
    """(n,) of VERDICT: the tests between two cars. Who of the two is to blame, and how surely, is not in the evidence,
    for the rows of their neighbours have a say in it: `confidence` says nothing."""


def bank_row(checkpoint: bytes, config: DetectorConfig) -> Records:
    """Return the row of the bank that was written down as `checkpoint`.

    Raises
    ------
    ValueError
        The bytes are not a row of this model, as this version of the core keeps it.
    """
    dtype = judges(config).dtype
    if len(checkpoint) != dtype.itemsize:
        raise ValueError(f"a checkpoint of {len(checkpoint)} bytes, where a row of this version has {dtype.itemsize}")
    row: Records = np.frombuffer(checkpoint, dtype)[0]
    return row


def replay(evidence: Evidence, config: DetectorConfig) -> Replay:
    """Judge every reading of the evidence again, beginning at its checkpoint."""
    judging = judges(config)
    model, readings = judging.model, evidence.readings
    # Two rows, though one is used: the kernels have been compiled for banks, whose columns are apart in memory.
    bank = np.zeros(2, judging.dtype)
    bank[0] = evidence.checkpoint
    row = np.zeros(1, np.int64)
    verdicts = banks.verdicts(readings.size)
    for k in range(readings.size):
        model.step_batch(bank["model"], row, readings[k : k + 1], model.params, verdicts[k : k + 1])
    links = np.zeros(readings.size, LINK_VERDICT)
    _step_link(bank["link"], evidence.leaders, standing(readings, verdicts), judging.link_params, links)
    return Replay(verdicts, link_said(links, verdicts))


@njit(cache=True)
def _step_link(links: Any, leaders: Any, readings: Any, p: Any, verdicts: Any) -> None:
    """Take the readings one after the other through row 0 of `links`."""
    for i in range(readings.size):
        step_pair(links[0], leaders[i], readings[i], p, verdicts[i])
