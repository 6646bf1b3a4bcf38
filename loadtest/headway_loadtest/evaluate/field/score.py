"""What alarms are worth: false ones of clean recordings by kind and cause, and injected faults found.

An alarm is one event id. A fault is **found** when an alarm of its vehicle has an alarming reading between the fault's
first message and `GRACE_S` after its last; a miss concerns silence, and finds none of these faults. Sensor and kind
are those of the newest update up to the end of that window. A clean alarm counts as **false** unless the recording
itself has a gap within `causes.GAP_WITHIN_S` of its onset.
"""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Self

import numpy as np

from headway_loadtest.evaluate.field.causes import Facts
from headway_loadtest.evaluate.field.detection import Alarm, Detection, EventUpdate
from headway_loadtest.evaluate.field.faults import Fault

GRACE_S = 1.0
"""An alarm up to this long after a fault is due to it."""
MOMENT_S = 5.0
"""Alarms of one recording that begin within this time of each other are one moment."""
LINK_KINDS = ("response", "range")
GAP = "recording-gap"
BOTH, MISS = "both", "miss"


@dataclass(slots=True)
class Sums:
    """Base of scores: sums over recordings, added field by field."""

    def __iadd__(self, other: Self) -> Self:
        """Add another's sums."""
        for each in fields(self):
            mine, more = getattr(self, each.name), getattr(other, each.name)
            if isinstance(mine, Counter):
                mine.update(more)
            else:
                setattr(self, each.name, mine + more)
        return self


@dataclass(slots=True)
class CleanScore(Sums):
    """Alarms of recordings without injected faults."""

    vehicle_hours: float = 0.0
    moving_hours: float = 0.0
    pair_hours: float = 0.0
    kinds: Counter[str] = field(default_factory=Counter)
    causes: Counter[str] = field(default_factory=Counter)
    observations: Counter[str] = field(default_factory=Counter)
    moving_kinds: Counter[str] = field(default_factory=Counter)
    at_gaps: int = 0
    """Alarms that a recorded gap explains; they are in no other sum."""
    moments: int = 0
    cars: int = 0
    cars_named: int = 0
    """Cars that any alarm, of those counted, names as its suspect."""


@dataclass(slots=True)
class FaultScore(Sums):
    """Injected faults, of all states or of the moving slice."""

    faults: Counter[str] = field(default_factory=Counter)
    found: Counter[str] = field(default_factory=Counter)
    by_chance: int = 0
    """Faults that an alarm of the clean recording would have been counted for."""
    sensor_right: int = 0
    kind_right: int = 0
    confusion: Counter[tuple[str, str]] = field(default_factory=Counter)
    delays_s: list[float] = field(default_factory=list)
    false_between: int = 0
    """Alarms that overlap no fault of a vehicle that takes part in them."""
    hours: float = 0.0
    """Vehicle-hours that these come from."""


def clean_score(facts: Mapping[str, Facts], detection: Detection) -> CleanScore:
    """Count the alarms of a recording without faults, by what `facts` say of its vehicles."""
    made = CleanScore(pair_hours=detection.pair_hours, cars=len(facts))
    for one in facts.values():
        made.vehicle_hours += float(one.interval_h.sum())
        made.moving_hours += float(one.interval_h[one.moving].sum())
    counted: list[Alarm] = []
    for alarm in detection.alarms:
        kind, suspect = alarm.newest.kind, facts[alarm.newest.suspect]
        cause = suspect.cause(alarm)
        if cause == GAP:
            made.at_gaps += 1
            continue
        counted.append(alarm)
        made.kinds[kind] += 1
        made.causes[cause] += 1
        made.observations.update(alarm.observations)
        made.moving_kinds[kind] += suspect.is_moving(alarm.start_us)
    made.moments = moments(alarm.start_us for alarm in counted)
    made.cars_named = len({name for alarm in counted for name in alarm.suspects})
    return made


def moments(times_us: Iterable[int]) -> int:
    """Count the groups of times that are at most `MOMENT_S` apart."""
    at = np.sort(np.fromiter(times_us, np.int64))
    return int(at.size > 0) + int((np.diff(at) > MOMENT_S * 1e6).sum())


def fault_scores(
    facts: Mapping[str, Facts], faults: Sequence[Fault], detection: Detection, clean: Detection
) -> tuple[FaultScore, FaultScore]:
    """Compare the alarms with the faults: over all states, and over those that begin in the moving slice.

    `facts` and `clean` are of the recording before the faults were put in.
    """
    everywhere, moving = FaultScore(), FaultScore()
    alarms, clean_alarms = _by_suspect(detection), _by_suspect(clean)
    for fault in faults:
        one = _score_fault(fault, faults, alarms.get(fault.vehicle, ()), detection.end_us)
        one.by_chance = int(_first_alarm(fault, clean_alarms.get(fault.vehicle, ()), clean.end_us) is not None)
        everywhere += one
        if facts[fault.vehicle].is_moving(fault.start_us):
            moving += one
    return everywhere, moving


def beside(faults: Sequence[Fault], detection: Detection) -> Detection:
    """Return the detection with those alarms only that overlap no fault, `GRACE_S` included, of a vehicle in them."""
    windows: dict[str, list[tuple[int, int]]] = {}
    for fault in faults:
        windows.setdefault(fault.vehicle, []).append((fault.start_us, fault.stop_us + round(GRACE_S * 1e6)))

    def is_beside(alarm: Alarm) -> bool:
        until_us = alarm.alarmed_until_us(detection.end_us)
        parties = {alarm.follower, alarm.leader or alarm.follower, *alarm.suspects}
        return not any(
            alarm.start_us <= stop_us and start_us <= until_us
            for vehicle in parties
            for start_us, stop_us in windows.get(vehicle, ())
        )

    return replace(detection, alarms=tuple(alarm for alarm in detection.alarms if is_beside(alarm)))


def _by_suspect(detection: Detection) -> dict[str, list[Alarm]]:
    """Return the alarms that concern readings by every vehicle that they name."""
    alarms: dict[str, list[Alarm]] = {}
    for alarm in detection.alarms:
        if alarm.newest.kind != MISS:
            for name in alarm.suspects:
                alarms.setdefault(name, []).append(alarm)
    return alarms


def _score_fault(fault: Fault, faults: Sequence[Fault], alarms: Sequence[Alarm], end_us: int) -> FaultScore:
    label = fault.kind.label
    made = FaultScore(faults=Counter({label: 1}))
    first_us = _first_alarm(fault, alarms, end_us)
    if first_us is None:
        return made
    made.found[label] = 1
    made.delays_s.append((first_us - fault.start_us) / 1e6)
    newest = _newest_in(fault, alarms)
    if newest is None:
        return made
    at_once = [other for other in faults if other.vehicle == fault.vehicle and _overlap(other, fault)]
    made.sensor_right = int(newest.sensor == BOTH or any(newest.sensor == other.sensor.value for other in at_once))
    made.kind_right = int(any(newest.kind == other.kind.label for other in at_once))
    made.confusion[label, newest.kind] = 1
    return made


def _overlap(one: Fault, other: Fault) -> bool:
    return one.start_us <= other.stop_us and other.start_us <= one.stop_us


def _first_alarm(fault: Fault, alarms: Sequence[Alarm], end_us: int) -> int | None:
    """Return the time of the first alarming reading in the fault's window, None where there is none."""
    until_us = fault.stop_us + round(GRACE_S * 1e6)
    times = [
        max(alarm.start_us, fault.start_us)
        for alarm in alarms
        if alarm.start_us <= until_us and alarm.alarmed_until_us(end_us) >= fault.start_us
    ]
    return min(times, default=None)


def _newest_in(fault: Fault, alarms: Sequence[Alarm]) -> EventUpdate | None:
    """Return the newest alarming update up to the end of the fault's window that names the vehicle."""
    until_us = fault.stop_us + round(GRACE_S * 1e6)
    updates = (
        update
        for alarm in alarms
        for update in alarm.updates
        if update.is_alarm and update.suspect == fault.vehicle and update.t_us <= until_us
    )
    return max(updates, key=lambda update: update.t_us, default=None)


def clean_row(score: CleanScore) -> dict[str, Any]:
    """Return the false alarms of a set as the JSON has them; None where there was nothing to measure."""
    links = sum(score.kinds[kind] for kind in LINK_KINDS)
    return {
        "vehicle_hours": score.vehicle_hours,
        "pair_hours": score.pair_hours,
        "false_alarms": score.kinds.total(),
        "false_alarms_per_hour": ratio(score.kinds.total(), score.vehicle_hours),
        "false_alarms_by_kind": dict(sorted(score.kinds.items())),
        "false_alarms_by_cause": dict(sorted(score.causes.items())),
        "false_alarms_by_observation": dict(sorted(score.observations.items())),
        "alarms_at_recording_gaps": score.at_gaps,
        "moments_per_hour": ratio(score.moments, score.vehicle_hours),
        "link_false_alarms_per_pair_hour": ratio(links, score.pair_hours),
        "cars": score.cars,
        "cars_named": score.cars_named,
    }


def fault_row(score: FaultScore) -> dict[str, Any]:
    """Return recall and what was stated of the faults found, as the JSON has them."""
    found, faults = score.found.total(), score.faults.total()
    return {
        "faults": faults,
        "recall": ratio(found, faults),
        "recall_by_kind": {kind: score.found[kind] / count for kind, count in sorted(score.faults.items())},
        "recall_by_chance": ratio(score.by_chance, faults),
        "sensor_correct": ratio(score.sensor_right, found),
        "kind_correct": ratio(score.kind_right, found),
        "confusion": nested(score.confusion),
        "false_alarms_per_hour_between_faults": ratio(score.false_between, score.hours),
        "time_to_detect_s": float(np.median(score.delays_s)) if score.delays_s else None,
    }


def ratio(part: float, whole: float) -> float | None:
    """Return part / whole; None of nothing."""
    return part / whole if whole else None


def nested(counts: Counter[tuple[str, str]]) -> dict[str, dict[str, int]]:
    """Return counts of (true, stated) by the true word, then by the stated one."""
    made: dict[str, dict[str, int]] = {}
    for (true, stated), count in sorted(counts.items()):
        made.setdefault(true, {})[stated] = count
    return made
