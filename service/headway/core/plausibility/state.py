"""What the plausibility checks keep of one vehicle, and the names of what they observe."""

import numpy as np

from headway.core.types.records import Observation

FIXES = 16
"""Positions kept, at most one in `FIX_SPACING_S`: 4.8 s. A power of two."""

FIX_SPACING_S = 0.3

ODD_READING = 2.5
"""Fewer steps beyond the limits, the last one of them back, are a single odd reading, and over."""

EAST, NORTH, WAY, SPEED = range(4)
"""Columns of a fix."""

PLAUSIBILITY = np.dtype(
    [
        ("count", "i8"),  # messages taken; 0: none yet
        ("t_s", "f8"),
        ("v_mps", "f8"),
        ("heading_east", "f8"),  # declared by the last message; (0, 0): none
        ("heading_north", "f8"),
        ("east_m", "f8"),  # position, seen from the first one, without steps that no car makes
        ("north_m", "f8"),
        ("jumped_m", "f8", (2,)),  # sum of those, east and north
        ("way_m", "f8"),  # integral of the reported speed
        ("fix_t_s", "f8"),  # when the position last became another
        ("fix_way_m", "f8"),
        ("ground_mps", "f8"),  # speed over ground of the last second,
        ("ground", "f8", (2,)),  # and its parts, east and north
        ("interval_s", "f8"),  # shortest step of time of late
        ("held_s", "f8"),  # how long a position was repeated, at most, of late
        ("late_s", "f8"),  # how late a new position may have been received, at most, of late
        ("fix_count", "i8"),
        ("newest", "i8"),
        ("fix_s", "f8", (FIXES,)),
        ("fixes", "f4", (FIXES, 4)),  # ring of EAST, NORTH, WAY, SPEED
        ("before_mps", "f8"),  # speed one second ago
        ("speed_since_s", "f8"),  # when the speed last became another
        ("speed_change_mps", "f8"),  # by how much,
        ("speed_change_s", "f8"),  # and within which time
        ("speed_interval_s", "f8"),  # shortest time between two such changes of late
        ("repeats", "f8"),  # messages since then
        ("speed_step", "f8"),  # last change of the speed, m/s
        ("resolution", "f8"),  # smallest change of the speed seen, m/s
        ("dither", "f8"),  # share of second differences of the speed of three resolutions or more
        ("roughness", "f8"),  # mean square of those, in resolutions^2
        ("dithers", "f8"),  # second differences taken
        ("position_score", "f8"),  # evidence of each check; 1 is an observation
        ("speed_score", "f8"),
        ("jerk_score", "f8"),
        ("heading_score", "f8"),
        ("short_ms", "f8"),  # accumulated mismatch of speed and displacement over one second,
        ("long_ms", "f8"),  # and over four
        ("surplus", "f8"),  # messages beyond the highest rate
        ("contradictions", "f8"),
        ("jumps", "f8", (2,)),  # steps beyond the limits of late: position, speed
        ("odd_from_mps", "f8"),  # speed before the last step of it beyond the limits
        ("other_s", "f8"),  # the place left by the last jump of the position: when,
        ("other_m", "f8", (2,)),  # and where, east and north
        ("returns", "f8"),  # jumps back to that place, less those to somewhere else
        ("mismatch_sensor", "i8"),  # which of the two is wrong while they contradict
        ("change_s", "f8"),  # when a plausible motion changed beyond limits; 0: never
        ("change_from_mps", "f8"),
        ("plausible_s", "f8"),  # for how long the motion has been plausible since
        ("observed", "i8"),  # Observation flags that stand
        ("since_s", "f8"),  # when the first of them was made
    ],
    align=True,
)
"""One row per vehicle; all zeros is a vehicle not heard yet."""

POSITION_CHANGE = int(Observation.POSITION_CHANGE)
POSITION_FROZEN = int(Observation.POSITION_FROZEN)
SPEED_VALUE = int(Observation.SPEED_VALUE)
SPEED_CHANGE = int(Observation.SPEED_CHANGE)
SPEED_FROZEN = int(Observation.SPEED_FROZEN)
POSITION_SPEED = int(Observation.POSITION_SPEED)
ACCELERATION = int(Observation.ACCELERATION)
HEADING = int(Observation.HEADING)
IDENTITY = int(Observation.IDENTITY)
INTERVAL = int(Observation.INTERVAL)
CONTRADICTION = int(Observation.CONTRADICTION)
JERK = int(Observation.JERK)
OVERLAP = int(Observation.OVERLAP)
APPEARANCE = int(Observation.APPEARANCE)
