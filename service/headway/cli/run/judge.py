"""`headway judge`: recordings through the service's own engine, at full speed, without a bus or a clock."""

import json
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import IO, Final

import numpy as np
import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from headway.cli.run.output_file import replaced
from headway.cli.run.recorded.refusals import Reading
from headway.cli.run.recorded.report import Summary, show
from headway.cli.run.verdict_files import VerdictWriter, verdict_writer
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records
from headway.detector import Detector, ReceivedError
from headway.errors import UserError
from headway.gateways.recordings.formats import Located, Recordings, open_recordings
from headway.gateways.recordings.reader import RecordingError
from headway.result import VERDICTS, Result
from headway.settings import Settings
from headway_schemas.event import Event

DRIVES_AT_ONCE: Final = 16
"""Drives whose records may alternate in a recording; each has a detector of its own."""


def judge(
    reading: Reading,
    settings: Settings,
    *,
    events: Path | None,
    verdicts: Path | None,
    as_json: bool,
) -> None:
    """Judge recordings and print the summary.

    Raises
    ------
    UserError
        A recording cannot be read, or a file cannot be written.
    """
    try:
        with ExitStack() as stack:
            recordings = stack.enter_context(open_recordings(reading.sources, reading.form, reading.columns))
            event_file = stack.enter_context(replaced(events)) if events else None
            writer = stack.enter_context(verdict_writer(verdicts)) if verdicts else None
            bar = stack.enter_context(_progress(recordings))
            judging = _Judging(settings, event_file)
            _judge(judging, recordings, writer, bar)
    except RecordingError as error:
        raise UserError(str(error)) from None
    judging.summary.refusals.show()
    if as_json:
        typer.echo(json.dumps(judging.summary.to_json()))
    else:
        show(judging.summary.to_json())


class _Judging:
    """Detectors of the drives under way, and what they found. Records of two drives never meet."""

    def __init__(self, settings: Settings, events: IO[bytes] | None) -> None:
        self.summary = Summary(settings.max_gap_s)
        self._settings = settings
        self._events = events
        self._detectors: OrderedDict[str, Detector] = OrderedDict()

    def process(self, chunk: Sequence[Located]) -> Records:
        """Judge a chunk; return a verdict for each row, in order."""
        verdicts = np.zeros(len(chunk), VERDICTS)
        by_drive: dict[str, list[int]] = {}
        for place, located in enumerate(chunk):
            if located.refusal is not None:
                verdicts["outcome"][place] = located.refusal.reason
                self.summary.add_refused(located, *located.refusal, count=True)
            elif located.record:
                by_drive.setdefault(located.drive, []).append(place)
            else:
                self.summary.truth.add_label(located)
        for drive, places in by_drive.items():
            verdicts[places] = self._of_drive(drive, [chunk[place] for place in places])
        return verdicts

    def finish(self) -> None:
        """Let time pass until every event has ended."""
        while self._detectors:
            self._finish_oldest()

    def _of_drive(self, drive: str, chunk: list[Located]) -> Records:
        detector = self._detectors.pop(drive, None)
        if detector is None:
            if len(self._detectors) == DRIVES_AT_ONCE:
                self._finish_oldest()
            detector = Detector(site=self._settings.site, **asdict(self._settings.detector()))
        self._detectors[drive] = detector
        result = _process(detector, chunk)
        self._add(drive, result)
        self.summary.add_qualities(drive, detector.qualities())
        if drive:
            self.summary.add_problems(chunk, result)
        for located, is_anomalous in zip(chunk, result.verdicts["anomalous"].tolist(), strict=True):
            if located.truth is not None:
                self.summary.truth.add_verdict(located, is_anomalous=is_anomalous)
        return result.verdicts

    def _finish_oldest(self) -> None:
        drive, detector = self._detectors.popitem(last=False)
        self._add(drive, detector.finish())

    def _add(self, drive: str, result: Result) -> None:
        self.summary.add(drive, result)
        _write_events(self._events, result.events)


def _judge(judging: _Judging, recordings: Recordings, verdicts: VerdictWriter | None, bar: Progress) -> None:
    task = bar.add_task("judging", total=1.0)
    for chunk in recordings.chunks:
        found = judging.process(chunk)
        if verdicts is not None:
            rows = list(_with_verdict(chunk))
            verdicts.write([chunk[row].record for row in rows], found[rows])
        bar.update(task, completed=recordings.share)
    judging.finish()


def _with_verdict(chunk: Sequence[Located]) -> Iterator[int]:
    """Yield the places of all rows but those of ground truth."""
    return (place for place, located in enumerate(chunk) if located.record or located.refusal is not None)


def _process(detector: Detector, chunk: list[Located]) -> Result:
    """Judge a chunk; a record of BSM v1 that is not of its form is an error of the recording, not of a sender."""
    records = [located.record for located in chunk]
    try:
        result = detector.process(records)
    except ReceivedError as error:
        raise chunk[error.place].source.error(error.problem, chunk[error.place].number) from None
    for place, problem in result.problems.items():
        if result.verdicts["outcome"][place] == Outcome.MALFORMED.label and not chunk[place].drive:
            raise chunk[place].source.error(problem, chunk[place].number)
    return result


def _write_events(file: IO[bytes] | None, events: Sequence[Event]) -> None:
    if file is not None:
        file.writelines(event.model_dump_json().encode() + b"\n" for event in events)


def _progress(recordings: Recordings) -> Progress:
    """Return a bar on standard error; silent where that is no terminal or the length is unknown."""
    console = Console(stderr=True)
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    known = all(source.path is not None for source in recordings.sources)
    return Progress(*columns, console=console, disable=not (known and console.is_terminal), transient=True)
