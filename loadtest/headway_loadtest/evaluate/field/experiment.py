"""Recordings, clean and with faults, before the service's engine: one row for each set and severity."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass, field
from multiprocessing import get_context
from typing import Any

from headway_loadtest.evaluate.field.causes import facts_of
from headway_loadtest.evaluate.field.detection import detect
from headway_loadtest.evaluate.field.faults import with_faults
from headway_loadtest.evaluate.field.recordings import Recording
from headway_loadtest.evaluate.field.score import (
    CleanScore,
    FaultScore,
    clean_row,
    clean_score,
    fault_row,
    fault_scores,
    ratio,
)

Progress = Callable[[int, int], None]
"""Called with the finished and the total number of parts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FieldProtocol:
    """What is run. `severities` are variances, m^2 and (m/s)^2; `runs` realisations of faults and of noise."""

    severities: tuple[float, ...] = (1.0, 0.5, 0.1)
    runs: int = 3
    seed: int = 0
    budget_per_hour: float = 1.0


@dataclass(slots=True)
class SetScore:
    """Sums over the recordings of one set: clean, and by severity over all states and over the moving slice."""

    clean: CleanScore = field(default_factory=CleanScore)
    faults: dict[float, tuple[FaultScore, FaultScore]] = field(default_factory=dict)


def run_field(
    recordings: Sequence[Recording], protocol: FieldProtocol, processes: int, progress: Progress
) -> list[dict[str, Any]]:
    """Run the protocol and return `rows`, one for each set and severity."""
    sets: dict[str, SetScore] = {}
    jobs = [(recording, protocol) for recording in recordings]
    with workers(processes) as spread:
        for done, (recording, scored) in enumerate(zip(recordings, spread(_measure, jobs), strict=True), 1):
            total = sets.setdefault(recording.group, SetScore())
            total.clean += scored.clean
            for c, pair in scored.faults.items():
                for mine, more in zip(total.faults.setdefault(c, (FaultScore(), FaultScore())), pair, strict=True):
                    mine += more  # noqa: PLW2901 - added in place
            progress(done, len(jobs))
    return [row for group, scored in sets.items() for row in _rows(group, scored)]


@contextmanager
def workers(processes: int) -> Iterator[Callable[..., Iterable[Any]]]:
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
    made = SetScore(clean_score(recording, clean))
    for c in protocol.severities:
        sums = made.faults.setdefault(c, (FaultScore(), FaultScore()))
        for run in runs_of(recording, protocol.runs):
            faulty, faults = with_faults(recording, c, protocol.seed, run)
            scores = fault_scores(facts, faults, detect(faulty, protocol.budget_per_hour), clean)
            for mine, more in zip(sums, scores, strict=True):
                mine += more  # noqa: PLW2901 - added in place
    return made


def _rows(group: str, scored: SetScore) -> Iterator[dict[str, Any]]:
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
