"""Recordings before the service's engine: clean and with faults, degraded, and with attackers among them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from itertools import product
from multiprocessing import get_context
from typing import Any

from headway_loadtest.evaluate.field import misbehaviour
from headway_loadtest.evaluate.field.causes import facts_of
from headway_loadtest.evaluate.field.degradations import DEGRADATIONS, JUMPS, degrade, with_jumps
from headway_loadtest.evaluate.field.detection import Detection, detect
from headway_loadtest.evaluate.field.faults import with_faults
from headway_loadtest.evaluate.field.misbehaviour import ONSETS, Attacked, AttackScore
from headway_loadtest.evaluate.field.recordings import Recording
from headway_loadtest.evaluate.field.score import (
    MISS,
    CleanScore,
    FaultScore,
    beside,
    clean_row,
    clean_score,
    fault_row,
    fault_scores,
    ratio,
)

GROUND_TRUTH, RECORDED = "ground truth", "recorded"
"""Attack and onset of recordings whose attackers their data set names."""
Progress = Callable[[int, int], None]
"""Called with the finished and the total number of parts."""
Spread = Callable[..., Iterable[Any]]
"""A `map`, in this process or over several."""
Row = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldProtocol:
    """What is run. `severities` are variances, m^2 and (m/s)^2; `runs` realisations of all chance."""

    severities: tuple[float, ...] = (1.0, 0.5, 0.1)
    runs: int = 3
    seed: int = 0
    budget_per_hour: float = 1.0
    degrade: bool = False
    attacks: tuple[str, ...] = ()
    """Words of `attacks.ATTACKS`."""


@dataclass(slots=True)
class SetScore:
    """Sums over the recordings of one set: clean, and by severity over all states and over the moving slice."""

    clean: CleanScore = field(default_factory=CleanScore)
    faults: dict[float, tuple[FaultScore, FaultScore]] = field(default_factory=dict)


@dataclass(slots=True)
class DegradedScore:
    """Sums over recordings with one degradation; `jumps` where position jumps are the faults to find."""

    alarms: CleanScore = field(default_factory=CleanScore)
    jumps: FaultScore = field(default_factory=FaultScore)


def run_field(
    recordings: Sequence[Recording],
    labelled: Sequence[Attacked],
    protocol: FieldProtocol,
    processes: int,
    progress: Progress,
) -> dict[str, list[Row]]:
    """Run the protocol; return `rows`, `degradations` and `attacks` of the JSON.

    `labelled` are recordings with attackers in them, which are judged once, as they are.
    """
    groups = dict.fromkeys(recording.group for recording in recordings)
    with_runs = [(recording, run) for recording in recordings for run in runs_of(recording, protocol.runs)]
    names = (*DEGRADATIONS, *JUMPS) if protocol.degrade else ()
    degrading = [(recording, run, name, protocol) for (recording, run), name in product(with_runs, names)]
    cases = tuple(product(protocol.attacks, ONSETS))
    attacking = [
        (recording, run, name, onset, protocol) for (recording, run), (name, onset) in product(with_runs, cases)
    ]
    done, of = 0, len(recordings) + len(degrading) + len(attacking) + len(labelled)

    sets = {group: SetScore() for group in groups}
    degraded = {key: DegradedScore() for key in product(groups, names)}
    attacked = {(group, name, onset): AttackScore() for group, (name, onset) in product(groups, cases)}
    truth = {one.recording.group: AttackScore() for one in labelled}
    with workers(processes) as spread:
        judged = spread(_measure, [(recording, protocol) for recording in recordings])
        for recording, measured in zip(recordings, judged, strict=True):
            _add(sets[recording.group], measured)
            progress(done := done + 1, of)
        for job, (alarms, jumps) in zip(degrading, spread(_measure_degraded, degrading), strict=True):
            total = degraded[job[0].group, job[2]]
            total.alarms += alarms
            total.jumps += jumps
            progress(done := done + 1, of)
        for attack, scored in zip(attacking, spread(_measure_attack, attacking), strict=True):
            attacked[attack[0].group, attack[2], attack[3]] += scored
            progress(done := done + 1, of)
        for one, scored in zip(labelled, spread(_measure_labelled, [(one, protocol) for one in labelled]), strict=True):
            truth[one.recording.group] += scored
            progress(done := done + 1, of)
    return {
        "rows": [row for group, scored in sets.items() for row in _rows(group, scored)],
        "degradations": [_degraded_row(*key, total) for key, total in degraded.items()],
        "attacks": [
            *(misbehaviour.row(*key, total) for key, total in attacked.items()),
            *(misbehaviour.row(group, GROUND_TRUTH, RECORDED, total) for group, total in truth.items()),
        ],
    }


@contextmanager
def workers(processes: int) -> Iterator[Spread]:
    """Give a `map` that works in this process, or in several."""
    if processes == 1:
        yield map
        return
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        yield pool.map


def runs_of(recording: Recording, runs: int) -> Sequence[int]:
    """Return the runs of a recording: its own where it is one realisation of several, else all."""
    return range(runs) if recording.run is None else (recording.run,)


def _measure(job: tuple[Recording, FieldProtocol]) -> SetScore:
    """Judge one recording clean, and with faults in each run and severity."""
    recording, protocol = job
    facts = facts_of(recording)
    clean = detect(recording, protocol.budget_per_hour)
    made = SetScore(clean_score(facts, clean))
    for c in protocol.severities:
        everywhere, moving = made.faults[c] = (FaultScore(), FaultScore())
        for run in runs_of(recording, protocol.runs):
            faulty, faults = with_faults(recording, c, protocol.seed, run)
            detection = detect(faulty, protocol.budget_per_hour)
            scores = fault_scores(facts, faults, detection, clean)
            everywhere += scores[0]
            moving += scores[1]
            between = clean_score(facts, beside(faults, detection))
            everywhere.false_between += between.kinds.total()
            everywhere.hours += between.vehicle_hours
    return made


def _measure_degraded(job: tuple[Recording, int, str, FieldProtocol]) -> tuple[CleanScore, FaultScore]:
    """Judge one recording with one degradation; gaps and causes are those of the original."""
    recording, run, name, protocol = job
    facts = facts_of(recording)
    if name in JUMPS:
        faulty, jumps = with_jumps(recording, protocol.seed, run, along=JUMPS[name])
        detection = detect(faulty, protocol.budget_per_hour)
        return clean_score(facts, beside(jumps, detection)), fault_scores(
            facts, jumps, detection, Detection((), 0.0, 0)
        )[0]
    detection = detect(degrade(recording, name, protocol.seed, run), protocol.budget_per_hour)
    if DEGRADATIONS[name].silences:
        detection = replace(detection, alarms=tuple(one for one in detection.alarms if one.newest.kind != MISS))
    return clean_score(facts, detection), FaultScore()


def _measure_attack(job: tuple[Recording, int, str, str, FieldProtocol]) -> AttackScore:
    recording, run, name, onset, protocol = job
    attacked = misbehaviour.attack(recording, name, onset, protocol.seed, run)
    return misbehaviour.score(attacked, detect(attacked.recording, protocol.budget_per_hour))


def _measure_labelled(job: tuple[Attacked, FieldProtocol]) -> AttackScore:
    attacked, protocol = job
    return misbehaviour.score(attacked, detect(attacked.recording, protocol.budget_per_hour))


def _add(total: SetScore, measured: SetScore) -> None:
    total.clean += measured.clean
    for c, (everywhere, moving) in measured.faults.items():
        mine = total.faults.setdefault(c, (FaultScore(), FaultScore()))
        for one, more in zip(mine, (everywhere, moving), strict=True):
            one += more  # noqa: PLW2901 - in place


def _rows(group: str, scored: SetScore) -> Iterator[Row]:
    clean = scored.clean
    moving = {
        "vehicle_hours": clean.moving_hours,
        "false_alarms_per_hour": ratio(clean.moving_kinds.total(), clean.moving_hours),
        "false_alarms_by_kind": dict(sorted(clean.moving_kinds.items())),
    }
    for c, (everywhere, while_moving) in scored.faults.items():
        yield {
            "set": group,
            "severity": c,
            **clean_row(clean),
            **fault_row(everywhere),
            "moving": moving | fault_row(while_moving),
        }


def _degraded_row(group: str, name: str, total: DegradedScore) -> Row:
    alarms = clean_row(total.alarms)
    return {
        "set": group,
        "degradation": name,
        "vehicle_hours": alarms["vehicle_hours"],
        "alarms": alarms["false_alarms"],
        "alarms_per_hour": alarms["false_alarms_per_hour"],
        "alarms_by_kind": alarms["false_alarms_by_kind"],
        "moments_per_hour": alarms["moments_per_hour"],
        "jumps": total.jumps.faults.total(),
        "jump_recall": fault_row(total.jumps)["recall"],
    }
