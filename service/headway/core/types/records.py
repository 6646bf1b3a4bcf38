"""What goes into a row kernel and what comes out of it.

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
        ("leader_t_s", "f8"),  # event time of the leader's sample; NaN: nobody ahead
        ("leader_x_m", "f8"),  # leader's front, in the follower's coordinate
        ("leader_v_mps", "f8"),
        ("leader_length_m", "f8"),
        ("range_m", "f8"),  # declared by the follower's forward sensor; NaN: none
        ("range_rate_mps", "f8"),
    ],
    align=True,
)
"""One message to judge: z = [x, v] and the input u = [x_leader, v_leader], each with its own time."""

VERDICT = np.dtype(
    [
        ("nis", "f8"),  # nu' S^-1 nu of the healthy hypothesis
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
        ("repaired", "?"),  # the covariance guard had to act
        ("restarted", "?"),  # the filter began anew from the reading
    ],
    align=True,
)
"""What the filter says of one reading."""


@unique
class Sensor(IntEnum):
    """Which reading cannot be true."""

    NONE = 0
    LOCATION = 1
    SPEED = 2
    BOTH = 3
    LINK = 4

    @property
    def label(self) -> str:
        """The word on the wire."""
        return self.name.lower()


@unique
class Kind(IntEnum):
    """How it is wrong: the paper's kinds, absence, and lies that agree with themselves."""

    NONE = 0
    SHORT = 1
    NOISE = 2
    BIAS = 3
    DRIFT = 4
    MISS = 5
    RESPONSE = 6  # does not answer the car ahead as its driver does
    RANGE = 7  # contradicts the forward sensor of the car behind

    @property
    def label(self) -> str:
        """The word on the wire."""
        return self.name.lower()
