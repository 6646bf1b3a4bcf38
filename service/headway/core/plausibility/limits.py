"""What cars and receivers can do: the limits of every plausibility check, each with its source.

Nothing here is learnt, so that no sender can move it. A limit leaves room for ordinary receivers: repeated positions,
1 Hz fixes in 10 Hz messages, clocks that jitter by 30 ms, positions 0.5 s older than the speed, scales off by 5 %.
"""

from typing import NamedTuple


class Limits(NamedTuple):
    """Limits in SI units."""

    speed_mps: float = 70.0
    """Highest speed of a road vehicle: production cars are limited to 250 km/h."""
    accel_mps2: float = 12.0
    """Highest change of speed: tyres on dry asphalt hold 1.0 to 1.2 g (Rajamani, Vehicle Dynamics, 2012)."""
    jerk_mps3: float = 40.0
    """Highest change of acceleration: twice that of emergency brakes (14 m/s3 in UN R157, 21 m/s3 at 80 km/h in
    Sensors 2021, 21(4), 1427)."""
    speed_slack_mps: float = 0.8
    """Change of speed between two messages that is never too large: steps of 1 mph and 3 sigma of Doppler noise."""
    speed_excess_mps: float = 2.5
    """A single change of speed this far beyond the limit is an observation by itself; smaller ones add up."""
    position_slack_m: float = 3.0
    """Step of a position that is never too large: single steps of receivers are off by up to 1 m at 10 Hz."""
    position_excess_m: float = 1.0
    """A single step this far beyond the limit is an observation by itself; smaller ones add up."""
    turn_mps2: float = 20.0
    """Highest lateral acceleration, speed times turn rate: 2 g, above any road vehicle."""
    turn_slack_rad: float = 0.35
    """Change of heading between two messages that is never too large: 20 degrees of course noise at low speed."""
    course_cos: float = 0.25
    """Cosine of the angle between heading and course over ground below which the two contradict: 75 degrees."""
    course_mps: float = 4.0
    """Speed over ground from which the course is known: nobody drives backwards so fast."""
    scale: float = 0.06
    """Share of the way by which speed and displacement may differ: wheel speeds are off by up to 5 %."""
    age_s: float = 0.6
    """How much older than the speed a position may be, s."""
    clock_s: float = 0.05
    """How far off the time of a message may be, s."""
    second_m: float = 1.6
    """Displacement that position noise makes within one second: four sigma of a 3 m walk over 30 s;"""
    long_m: float = 4.5
    """and the same over four seconds."""
    accuracy_share: float = 0.3
    """Share of the declared accuracy that is added to both: errors of a receiver are correlated over seconds."""
    mismatch_ms: float = 1.5
    """Distance beyond those limits, times the seconds that it lasts, from which speed and displacement contradict."""
    interval_s: float = 1.0 / 30.0
    """Shortest mean interval of messages: a third of the 100 ms of SAE J2945/1 and ETSI EN 302 637-2."""
    burst: float = 15.0
    """Messages beyond that rate that make an observation."""
    frozen_s: float = 6.0
    """A position that stays the same for longer while the speed is not zero is frozen: outages last for 5 s;"""
    frozen_first_s: float = 2.5
    """for a sender whose position never moved yet."""
    frozen_m: float = 8.0
    """Way by the reported speed that the position must have missed meanwhile."""
    fade_s: float = 0.6
    """Time constant with which the evidence of single steps fades;"""
    memory_s: float = 3.0
    """and that with which their number does: one step away and one back are a single odd reading."""
