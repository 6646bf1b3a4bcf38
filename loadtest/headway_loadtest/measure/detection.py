"""Detection quality: events against labels, in event time.

An episode is right if its onset falls within a labelled event of its suspect, or at most `GRACE_US` after it. An event
is found if a right episode of its vehicle overlaps it. Other episodes are false alarms, with two exceptions that are
counted apart: the suspect is the neighbour of a faulty vehicle, or a vehicle that has left. A dragged location stays
wrong until its vehicle leaves, so a later episode of it is right.
"""

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from headway_loadtest.inject.apply import Label
from headway_loadtest.inject.faults import Kind
from headway_loadtest.measure.subscriber import Episode
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas import Kind as AlertKind

GRACE_US = 1_000_000


@dataclass(frozen=True, slots=True)
class KindScore:
    """One kind of injected event. `named` is how many of those found were also called by their kind at the end."""

    events: int
    found: int
    named: int
    delay_s: float | None
    """Median from the first false reading until a subscriber had the alert, in event time."""


@dataclass(frozen=True, slots=True)
class Quality:
    """All events of a run. Rates are per hour that one vehicle drives."""

    by_kind: Mapping[str, KindScore]
    right: int
    false_alarms: int
    wrong_vehicle: int
    departures: int
    vehicle_hours: float

    @property
    def events(self) -> int:
        """Events injected."""
        return sum(score.events for score in self.by_kind.values())

    @property
    def found(self) -> int:
        """Events found."""
        return sum(score.found for score in self.by_kind.values())

    @property
    def false_alarms_per_vehicle_hour(self) -> float:
        """False alarms per hour that a fault-free vehicle drives."""
        return self.false_alarms / self.vehicle_hours if self.vehicle_hours else 0.0


def assess(
    labels: Sequence[Label],
    episodes: Iterable[Episode],
    *,
    schedule: Schedule,
    last_us: Mapping[str, int],
    vehicle_hours: float,
) -> Quality:
    """Hold episodes against labels, both in Unix event time; `last_us` is that of each vehicle's last message."""
    truth: dict[str, list[Label]] = defaultdict(list)
    for label in labels:
        truth[label.vehicle].append(label)
    right: dict[str, list[Episode]] = defaultdict(list)
    false_alarms = wrong_vehicle = departures = 0
    for episode in episodes:
        if any(_explains(label, episode.onset_us) for label in truth[episode.suspect]):
            right[episode.suspect].append(episode)
        elif episode.kind is AlertKind.MISS and episode.onset_us >= last_us.get(episode.suspect, 0):
            departures += 1
        elif any(_explains(label, episode.onset_us) for label in truth[_other(episode)]):
            wrong_vehicle += 1
        else:
            false_alarms += 1
    by_kind: dict[str, list[tuple[Label, Episode | None]]] = defaultdict(list)
    for label in labels:
        found = [episode for episode in right[label.vehicle] if _overlap(label, episode)]
        by_kind[label.kind.label].append((label, min(found, key=lambda episode: episode.onset_us, default=None)))
    return Quality(
        by_kind={kind: _score(pairs, schedule) for kind, pairs in sorted(by_kind.items())},
        right=sum(map(len, right.values())),
        false_alarms=false_alarms,
        wrong_vehicle=wrong_vehicle,
        departures=departures,
        vehicle_hours=vehicle_hours,
    )


def _explains(label: Label, onset_us: int) -> bool:
    if label.start_us > onset_us:
        return False
    return label.kind.is_consistent or onset_us <= label.stop_us + GRACE_US


def _overlap(label: Label, episode: Episode) -> bool:
    return episode.onset_us <= label.stop_us + GRACE_US and episode.last_us >= label.start_us


def _other(episode: Episode) -> str:
    return (episode.leader or "") if episode.suspect == episode.follower else episode.follower


def _names(kind: Kind) -> tuple[AlertKind, ...]:
    return (AlertKind.RESPONSE, AlertKind.RANGE) if kind.is_consistent else (AlertKind(kind.label),)


def _score(pairs: Sequence[tuple[Label, Episode | None]], schedule: Schedule) -> KindScore:
    found = [(label, episode) for label, episode in pairs if episode is not None]
    delays_s = [max(0.0, schedule.event_at_us(episode.received_ns) - label.start_us) / 1e6 for label, episode in found]
    return KindScore(
        events=len(pairs),
        found=len(found),
        named=sum(episode.kind in _names(label.kind) for label, episode in found),
        delay_s=median(delays_s) if delays_s else None,
    )
