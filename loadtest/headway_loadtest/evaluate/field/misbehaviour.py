"""Attackers among honest vehicles: which messages an open event covers, and whom it names.

A message is **found** while an event is open that names its sender, as the newest update has it. Misses concern
silence, and cover no message.
"""

import zlib
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from headway_loadtest.evaluate.field.attacks import ATTACKS, CATCH, CATCH_FALSE_POSITIVE_RATE, Context
from headway_loadtest.evaluate.field.detection import Detection
from headway_loadtest.evaluate.field.recordings import Bools, Recording, Records
from headway_loadtest.evaluate.field.score import MISS, Sums, ratio
from headway_loadtest.sources.drive import I64

ATTACKER_SHARE = 0.2
"""As in VeReMi-NextGen; at least one vehicle attacks."""
LEAST_MESSAGES = 100
"""A vehicle that is heard for less is no attacker: there would be no middle of its trip."""
ONSETS = {"birth": (0.0, 0.0), "mid": (0.4, 0.6)}
"""Part of an attacker's messages before its onset."""


@dataclass(frozen=True, slots=True)
class Attacked:
    """A recording with attackers in it. Arrays are (n,), of its messages in their order."""

    recording: Recording
    malicious: Bools
    honest: Bools
    """Messages of vehicles that never attack."""
    owner: dict[str, str]
    """Attacking vehicle of each id that it uses."""


@dataclass(slots=True)
class AttackScore(Sums):
    """Sums over recordings and runs."""

    malicious: int = 0
    found: int = 0
    honest: int = 0
    false_positives: int = 0
    attackers: int = 0
    attackers_named: int = 0
    events: int = 0
    """Events that an attacker takes part in, as suspect, follower or leader."""
    suspect_right: int = 0
    cars: int = 0
    """Honest cars."""
    cars_named: int = 0
    kinds: Counter[str] = field(default_factory=Counter)


def attack(recording: Recording, name: str, onset: str, seed: int, run: int) -> Attacked:
    """Let a fifth of the vehicles attack from their birth or from the middle of their trip."""
    rng = np.random.default_rng([seed, run, zlib.crc32(f"{recording.name} {name} {onset}".encode())])
    tracks = recording.tracks
    able = [which for which, track in enumerate(tracks) if len(track) >= LEAST_MESSAGES]
    count = min(len(able), max(1, round(ATTACKER_SHARE * len(able))))
    attackers = set(rng.choice(able, count, replace=False).tolist()) if able else set()
    by_time = recording.messages[np.argsort(recording.messages["t_us"], kind="stable")]
    vehicles, owner = list(recording.vehicles), {}
    parts: list[tuple[Records, Bools, Bools]] = []
    for which, track in enumerate(tracks):
        if which not in attackers:
            parts.append((track, np.zeros(len(track), np.bool_), np.ones(len(track), np.bool_)))
            continue
        vehicle = recording.vehicles[which]
        first = int(len(track) * rng.uniform(*ONSETS[onset]))
        context = Context(rng, by_time[by_time["vehicle"] != which])
        forged = ATTACKS[name](context, track[first:].copy())
        owner[vehicle] = vehicle
        messages = np.concatenate([track[:first], forged.messages])
        pseudonym = np.concatenate([np.zeros(first, np.int64), forged.pseudonym])
        for number in range(1, int(pseudonym.max(initial=0)) + 1):
            messages["vehicle"][pseudonym == number] = len(vehicles)
            vehicles.append(f"{vehicle}-{number}")
            owner[vehicles[-1]] = vehicle
        malicious = np.concatenate([np.zeros(first, np.bool_), forged.malicious])
        parts.append((_recounted(messages), malicious, np.zeros(len(messages), np.bool_)))
    messages, malicious, honest = (np.concatenate(columns) for columns in zip(*parts, strict=True))
    order = np.lexsort((messages["vehicle"], messages["t_us"], messages["received_us"]))
    made = Recording(
        group=recording.group,
        name=recording.name,
        vehicles=tuple(vehicles),
        messages=messages[order],
        run=recording.run,
    )
    return Attacked(made, malicious[order], honest[order], owner)


def of_ground_truth(recording: Recording, malicious: Bools) -> Attacked:
    """Return a recording with the attackers that its data set names; each id is a vehicle of its own."""
    attackers = np.unique(recording.messages["vehicle"][malicious])
    honest = ~np.isin(recording.messages["vehicle"], attackers)
    names = [recording.vehicles[which] for which in attackers.tolist()]
    return Attacked(recording, malicious, honest, dict(zip(names, names, strict=True)))


def _recounted(messages: Records) -> Records:
    """Let each id count its messages without a gap, as a modified sender would."""
    for vehicle in np.unique(messages["vehicle"]):
        own = np.flatnonzero(messages["vehicle"] == vehicle)
        own = own[np.argsort(messages["t_us"][own], kind="stable")]
        messages["msg_cnt"][own] = (messages["msg_cnt"][own[0]] + np.arange(own.size)) % 128
    return messages


def named(detection: Detection) -> dict[str, list[tuple[int, int]]]:
    """Return the event times (from, to) in which open events name each vehicle."""
    spans: dict[str, list[tuple[int, int]]] = {}
    for alarm in detection.alarms:
        if alarm.newest.kind == MISS:
            continue
        ends = [update.t_us for update in alarm.updates[1:]]
        if alarm.updates[-1].is_alarm:
            ends.append(detection.end_us)
        for update, end_us in zip(alarm.updates, ends, strict=False):
            spans.setdefault(update.suspect, []).append((update.t_us, end_us))
    return spans


def covered(recording: Recording, spans: dict[str, list[tuple[int, int]]]) -> Bools:
    """(n,) whether an open event names the sender at the event time of each message."""
    flags = np.zeros(len(recording.messages), np.bool_)
    t_us: I64 = recording.messages["t_us"]
    for which, vehicle in enumerate(recording.vehicles):
        if vehicle in spans:
            own = np.flatnonzero(recording.messages["vehicle"] == which)
            for start_us, end_us in spans[vehicle]:
                flags[own[(t_us[own] >= start_us) & (t_us[own] <= end_us)]] = True
    return flags


def score(attacked: Attacked, detection: Detection) -> AttackScore:
    """Compare the events with the attackers."""
    found = covered(attacked.recording, named(detection))
    owner, messages = attacked.owner, attacked.recording.messages
    senders = np.array(attacked.recording.vehicles)

    def of(flags: Bools) -> set[str]:
        return set(senders[np.unique(messages["vehicle"][flags])].tolist())

    active = {owner[name] for name in of(attacked.malicious)}
    honest_cars = of(attacked.honest)
    suspects = {name for alarm in detection.alarms for name in alarm.suspects}
    made = AttackScore(
        malicious=int(attacked.malicious.sum()),
        found=int((found & attacked.malicious).sum()),
        honest=int(attacked.honest.sum()),
        false_positives=int((found & attacked.honest).sum()),
        attackers=len(active),
        attackers_named=len({owner[name] for name in of(found & attacked.malicious)}),
        cars=len(honest_cars),
        cars_named=len(suspects & honest_cars),
    )
    for alarm in detection.alarms:
        if alarm.newest.kind != MISS and owner.keys() & {alarm.follower, alarm.leader, *alarm.suspects}:
            made.events += 1
            made.suspect_right += alarm.newest.suspect in owner
            made.kinds[alarm.newest.kind] += 1
    return made


def row(group: str, name: str, onset: str, total: AttackScore) -> dict[str, Any]:
    """Return the line of an attack as the JSON has it; None where there was nothing to measure."""
    return {
        "set": group,
        "attack": name,
        "onset": onset,
        "messages": total.malicious,
        "message_recall": ratio(total.found, total.malicious),
        "event_recall": ratio(total.attackers_named, total.attackers),
        "false_positive_rate": ratio(total.false_positives, total.honest),
        "suspect_correct": ratio(total.suspect_right, total.events),
        "events_by_kind": dict(sorted(total.kinds.items())),
        "honest_cars": total.cars,
        "honest_cars_named": total.cars_named,
        **_published(group, name, onset),
    }


def _published(group: str, name: str, onset: str) -> dict[str, float | None]:
    """Return what CaTCH is published to reach in the same sort of traffic."""
    places = [place for place in ("urban", "highway") if place in group]
    if not places or onset != "birth" or name not in CATCH:
        return {"catch_message_recall": None, "catch_false_positive_rate": None}
    at = ("urban", "highway").index(places[0])
    return {"catch_message_recall": CATCH[name][at], "catch_false_positive_rate": CATCH_FALSE_POSITIVE_RATE[at]}
