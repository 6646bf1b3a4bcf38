"""One numpy record per vehicle, and one compiled call per batch of readings.

The bank is a structured array whose dtype the model names. Each row holds a vehicle's state and delay buffers in one
piece, and a row of zeros is a vehicle that is not initialised.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from headway.core.types.records import READING, VERDICT, Records

BatchKernel = Callable[[Records, "np.ndarray[Any, np.dtype[np.int64]]", Records, Any, Records], None]


def readings(count: int) -> Records:
    """Return `count` empty readings: no leader, no range."""
    made = np.zeros(count, READING)
    for name in READING.names or ():
        made[name] = np.nan
    return made


def wipe(bank: Records, rows: "np.ndarray[Any, np.dtype[np.int64]]") -> None:
    """Set the `rows` to zeros as bytes, because numpy sets a record field by field."""
    bank.view(np.uint8).reshape(bank.size, -1)[rows] = 0


def verdicts(count: int) -> Records:
    """Return `count` empty verdicts."""
    return np.zeros(count, VERDICT)
