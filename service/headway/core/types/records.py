"""The input and the output of a row kernel.

Both are numpy records: a column has a name in Python and in the compiled kernels alike.
"""

from enum import IntEnum, unique

import numpy as np
from numpy.typing import NDArray

Records = NDArray[np.void]
"""A structured array; its dtype is named where it is made."""

READING = np.dtype(
    [
        ("t_s", "f8"),  # event time, s of Unix time
        ("x_m", "f8"),  # follower's location along its own path
        ("v_mps", "f8"),
        ("leader_t_s", "f8"),  # event time of the leader's sample; NaN: no leader
        ("leader_x_m", "f8"),  # leader's front, in the follower's coordinate
        ("leader_v_mps", "f8"),
        ("leader_length_m", "f8"),
        ("range_m", "f8"),  # declared by the follower's forward sensor; NaN: none
        ("range_rate_mps", "f8"),
    ],
    align=True,
)
"""One message: the measurement z = [x, v] and the input u = [x_leader, v_leader], each with its own time."""

VERDICT = np.dtype(
    [
        ("nis", "f8"),  # nu' S^-1 nu of the healthy mode
        ("statistic", "f8"),  # what is compared with the gate
        ("gate", "f8"),
        ("p_value", "f8"),
        ("nu", "f8", (2,)),  # innovation of location and speed
        ("S", "f8", (2, 2)),  # its covariance
        ("x_m", "f8"),  # estimate after the reading: the recovered value during an anomaly
        ("v_mps", "f8"),
        ("x_std_m", "f8"),
        ("v_std_mps", "f8"),
        ("sensor", "i8"),  # Sensor
        ("kind", "i8"),  # Kind, once anomalous
        ("confidence", "f8"),  # of the kind, 0..1
        ("anomalous", "?"),
        ("warming", "?"),
        ("repaired", "?"),  # the covariance was repaired
        ("restarted", "?"),  # the filter was initialised from the reading
    ],
    align=True,
)
"""The result for one reading."""


@unique
class Sensor(IntEnum):
    """The faulty sensor."""

    NONE = 0
    LOCATION = 1
    SPEED = 2
    BOTH = 3
    LINK = 4

    @property
    def label(self) -> str:
        """The name on the wire."""
        return self.name.lower()


@unique
class Kind(IntEnum):
    """The kind of the fault: those of the paper, absence, and self-consistent faults."""

    NONE = 0
    SHORT = 1
    NOISE = 2
    BIAS = 3
    DRIFT = 4
    MISS = 5
    RESPONSE = 6  # does not respond to the leader as its driver does
    RANGE = 7  # contradicts the forward sensor of the follower

    @property
    def label(self) -> str:
        """The name on the wire."""
        return self.name.lower()
