"""What the detector found in a chunk of records."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from headway.core.types.batch import I64, Ids
from headway.core.types.records import Records
from headway_schemas.event import Event

VERDICTS: Final = np.dtype(
    [
        ("outcome", "U18"),  # scored, warming, or the reason of the rejection
        ("anomalous", "?"),  # the statistic is beyond the gate, and the reading is this vehicle's fault
        ("statistic", "f8"),
        ("gate", "f8"),
        ("p_value", "f8"),  # share of fault-free readings with a statistic this high
        ("sensor", "U8"),  # location, speed, both or link; empty for none
        ("kind", "U8"),  # of the anomaly; empty for none
        ("x_m", "f8"),  # estimate along the vehicle's own path
        ("v_mps", "f8"),
        ("leader", "U64"),  # id of the vehicle ahead; empty for none
    ]
)
"""A row of `Result.verdicts`. Numbers of a rejected record are NaN."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Result:
    """What came of one chunk."""

    events: list[Event]
    """Event updates in the order of detection, as on the wire."""
    verdicts: Records
    """(R,) of dtype VERDICTS, a row for each record of the chunk, in its order."""
    problems: dict[int, str]
    """By the row of each invalid record, what is wrong with it."""
    readings: "Readings"
    """(R,) what the records say, for `plot`."""

    def plot(self, vehicle: str) -> Any:
        """Draw the readings of a vehicle, the estimates, the statistic and its gate over time.

        Returns the `matplotlib.figure.Figure`, which a notebook shows and `savefig` writes.

        Raises
        ------
        ValueError
            No record of this vehicle was judged in this chunk.
        ModuleNotFoundError
            matplotlib is not installed: `pip install 'headway[plots]'`.
        """
        from headway.result_plot import draw  # noqa: PLC0415 - matplotlib is an extra

        return draw(self, vehicle)


@dataclass(frozen=True, slots=True)
class Readings:
    """(R,) readings of each record; rejected ones are NaN and without an id."""

    ids: Ids
    t_us: I64
    x_m: NDArray[np.float64]
    """Along the vehicle's own path, as `x_m` of the verdict."""
    v_mps: NDArray[np.float64]
