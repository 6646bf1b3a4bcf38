"""`headway judge`: recordings through the service's own engine, at full speed, without a bus or a clock."""

import json
from collections import Counter
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import asdict
from pathlib import Path
from typing import IO, Any, Final

import typer
from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn
from rich.table import Table

from headway.cli.run.output_file import replaced
from headway.cli.run.verdict_files import VerdictWriter, verdict_writer
from headway.core.types.outcome import Outcome
from headway.detector import Detector, ReceivedError
from headway.errors import UserError
from headway.gateways.recordings.formats import Located, Recordings, open_recordings
from headway.gateways.recordings.reader import RecordingError
from headway.result import Result
from headway.settings import Settings
from headway_schemas.event import Event, Phase

_US_PER_HOUR: Final = 3.6e9


class Summary:
    """What `--json` prints, counted chunk by chunk."""

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_us = 1e6 * max_gap_s
        self._outcomes: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._open: dict[str, str] = {}
        self._last_us: dict[bytes, int] = {}
        self._observed_us = 0

    def add(self, result: Result) -> None:
        """Count the records and the events of one chunk."""
        self._outcomes.update(result.verdicts["outcome"].tolist())
        for vehicle, t_us in zip(result.readings.ids.tolist(), result.readings.t_us.tolist(), strict=True):
            if vehicle:
                since_us = t_us - self._last_us.get(vehicle, t_us)
                self._observed_us += since_us if since_us <= self._max_gap_us else 0
                self._last_us[vehicle] = t_us
        for event in result.events:
            self._open[event.event_id] = event.kind
            if event.phase is Phase.CLEARED:
                self._kinds[self._open.pop(event.event_id)] += 1

    def to_json(self) -> dict[str, Any]:
        """Return the counts; an event has the kind of its last update, and observed time no gap beyond max_gap_s."""
        kinds = self._kinds + Counter(self._open.values())
        hours = self._observed_us / _US_PER_HOUR
        return {
            "records": self._outcomes.total(),
            "outcomes": dict(sorted(self._outcomes.items())),
            "vehicles": len(self._last_us),
            "vehicle_hours": round(hours, 6),
            "events": dict(sorted(kinds.items())),
            "alarms": kinds.total(),
            "alarms_per_vehicle_hour": round(kinds.total() / hours, 6) if hours else None,
        }


def judge(
    sources: Sequence[str],
    settings: Settings,
    *,
    form: str,
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
            recordings = stack.enter_context(open_recordings(sources, form))
            event_file = stack.enter_context(replaced(events)) if events else None
            writer = stack.enter_context(verdict_writer(verdicts)) if verdicts else None
            show = stack.enter_context(_progress(recordings))
            detector = Detector(site=settings.site, **asdict(settings.detector()))
            summary = _judge(detector, recordings, Summary(settings.max_gap_s), event_file, writer, show)
    except RecordingError as error:
        raise UserError(str(error)) from None
    if as_json:
        typer.echo(json.dumps(summary.to_json()))
    else:
        _print(summary.to_json())


def _judge(
    detector: Detector,
    recordings: Recordings,
    summary: Summary,
    events: IO[bytes] | None,
    verdicts: VerdictWriter | None,
    show: Progress,
) -> Summary:
    task = show.add_task("judging", total=1.0)
    for chunk in recordings.chunks:
        result = _process(detector, chunk)
        summary.add(result)
        _write_events(events, result.events)
        if verdicts is not None:
            verdicts.write([located.record for located in chunk], result.verdicts)
        show.update(task, completed=recordings.share)
    rest = detector.finish()
    summary.add(rest)
    _write_events(events, rest.events)
    return summary


def _process(detector: Detector, chunk: list[Located]) -> Result:
    """Judge a chunk; a record that is not of the form of BSM v1 is an error of the recording, not of a sender."""
    records = [located.record for located in chunk]
    try:
        result = detector.process(records)
    except ReceivedError as error:
        raise chunk[error.place].source.error(error.problem, chunk[error.place].number) from None
    for place, problem in result.problems.items():
        if result.verdicts["outcome"][place] == Outcome.MALFORMED.label:
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


def _print(summary: dict[str, Any]) -> None:
    table = Table("outcome", "records", title=f"{summary['records']:,} records")
    for outcome, count in summary["outcomes"].items():
        table.add_row(outcome, f"{count:,}")
    console = Console()
    console.print(table)
    rate = summary["alarms_per_vehicle_hour"]
    console.print(
        f"{summary['vehicles']:,} vehicles, {summary['vehicle_hours']:.3f} vehicle hours,"
        f" {summary['alarms']:,} alarms" + ("" if rate is None else f", {rate:.3g} per vehicle hour")
    )
    for kind, count in summary["events"].items():
        console.print(f"  {kind}: {count:,}")
