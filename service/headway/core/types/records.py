"""The input and the output of a row kernel.

Both are numpy records: a column has a name in Python and in the compiled kernels alike.
"""

from enum import IntEnum, IntFlag, unique

import numpy as np
from numpy.typing import NDArray

Records = NDArray[np.void]
"""A structured array; its dtype is named where it is made."""

READING = np.dtype(
    [
        ("t_s", "f8"),  # event time, s of Unix time
        ("x_m", "f8"),  # follower's location along its own path
        ("odometer_std_m", "f8"),  # how sure x_m is beside the position's own noise; NaN: quite
        ("v_mps", "f8"),
        ("leader_t_s", "f8"),  # event time of the leader's sample; NaN: no leader
        ("leader_x_m", "f8"),  # leader's front, in the follower's coordinate
        ("leader_v_mps", "f8"),
        ("leader_length_m", "f8"),
        ("range_m", "f8"),  # declared by the follower's forward sensor; NaN: none
        ("range_rate_mps", "f8"),
        ("east_m", "f8"),  # displacement since the vehicle's last message
        ("north_m", "f8"),
        ("heading_deg", "f8"),  # as declared; NaN: not available
        ("accuracy_m", "f8"),  # as declared, 1 sigma; NaN: never
        ("overlapped", "f8"),  # 1 while it is in the place of another vehicle that was there before
        ("appeared", "f8"),  # 1 after it was first received in the middle of observed road
        ("contradictions", "f8"),  # messages since the last one that one sender cannot have sent beside it
    ],
    align=True,
)
"""One message: the measurement z = [x, v] and the input u = [x_leader, v_leader], each with its own time."""

_SINGLE_PRECISION = ("odometer_std_m", "leader_length_m", "range_m", "range_rate_mps", "heading_deg", "accuracy_m")
_FLAGS = ("overlapped", "appeared")
CONTRADICTIONS_MAX = 65_535
"""More of them in one reading are kept as so many; the check of them saturates far below."""
COMPACT_READING = np.dtype(
    [(name, "f8") for name in READING.names or () if name not in {*_SINGLE_PRECISION, *_FLAGS, "contradictions"}]
    + [(name, "f4") for name in _SINGLE_PRECISION]
    + [("leader", "i4"), ("contradictions", "u2"), *((name, "?") for name in _FLAGS)],
    align=True,
)
"""A reading as evidence keeps it, with the row of its leader, -1 for none. The fields of single precision are rounded
where a READING is made, so nothing is lost."""

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
        ("observed", "i8"),  # Observation flags of the plausibility checks; written before the filter's step
        ("implausible", "i8"),  # Sensor that they concern
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
    HEADING = 8

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
    UNKNOWN = 8  # too early to say

    @property
    def label(self) -> str:
        """The name on the wire."""
        return self.name.lower()


@unique
class Observation(IntFlag):
    """What a plausibility check observes: each is one bit, and has its names in standards in the reference."""

    POSITION_CHANGE = 1 << 0
    POSITION_FROZEN = 1 << 1
    POSITION_SPEED = 1 << 2
    SPEED_VALUE = 1 << 3
    SPEED_CHANGE = 1 << 4
    SPEED_FROZEN = 1 << 5
    ACCELERATION = 1 << 6
    HEADING = 1 << 7
    INTERVAL = 1 << 8
    IDENTITY = 1 << 9
    CONTRADICTION = 1 << 10
    JERK = 1 << 11
    OVERLAP = 1 << 12
    APPEARANCE = 1 << 13

    @property
    def label(self) -> str:
        """The word on the wire."""
        return str(self.name).lower()
