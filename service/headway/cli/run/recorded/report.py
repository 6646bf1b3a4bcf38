"""What `headway judge` counts: outcomes, events, refused rows, and scores against ground truth."""

from collections import Counter
from collections.abc import Sequence
from typing import Any, Final

from rich.console import Console
from rich.table import Table

from headway.cli.run.recorded.refusals import Refusals
from headway.core.types.outcome import Outcome
from headway.gateways.recordings.formats import Located
from headway.result import Result
from headway_schemas.event import Phase
from headway_schemas.state import QualityLevel, SensorQuality

_US_PER_HOUR: Final = 3.6e9
_SHOWN_VEHICLES: Final = 20
_FORM: Final = frozenset(
    outcome.label for outcome in (Outcome.MALFORMED, Outcome.OUT_OF_RANGE, Outcome.NOT_FINITE, Outcome.UNAVAILABLE)
)
"""Outcomes of records that are wrong by themselves."""


class Summary:
    """What `--json` prints, counted part by part."""

    def __init__(self, max_gap_s: float) -> None:
        self._max_gap_us = 1e6 * max_gap_s
        self._outcomes: Counter[str] = Counter()
        self._kinds: Counter[str] = Counter()
        self._open: dict[tuple[str, str], str] = {}
        self._last_us: dict[tuple[str, bytes], int] = {}
        self._observed_us = 0
        self._qualities: dict[tuple[str, str], SensorQuality] = {}
        self.refusals = Refusals()
        self.truth = TruthScore()

    def add(self, drive: str, result: Result) -> None:
        """Count the records and the events of one part of a drive."""
        self._outcomes.update(result.verdicts["outcome"].tolist())
        for vehicle, t_us in zip(result.readings.ids.tolist(), result.readings.t_us.tolist(), strict=True):
            if vehicle:
                key = (drive, vehicle)
                since_us = t_us - self._last_us.get(key, t_us)
                self._observed_us += since_us if since_us <= self._max_gap_us else 0
                self._last_us[key] = t_us
        for event in result.events:
            self._open[drive, event.event_id] = event.kind
            if event.phase is Phase.CLEARED:
                self._kinds[self._open.pop((drive, event.event_id))] += 1

    def add_qualities(self, drive: str, qualities: Sequence[SensorQuality]) -> None:
        """Take what is known now of the sensors of the vehicles of a drive."""
        self._qualities.update({(drive, quality.vehicle): quality for quality in qualities})

    def add_refused(self, located: Located, outcome: str, problem: str, *, count: bool) -> None:
        """Note a row that is no record, or a record that is wrong by itself; count it where no result has it."""
        if count:
            self._outcomes[outcome] += 1
        self.refusals.add(located, outcome, problem)

    def add_problems(self, chunk: Sequence[Located], result: Result) -> None:
        """Note the records of a foreign recording that are wrong by themselves."""
        for place, problem in result.problems.items():
            outcome = str(result.verdicts["outcome"][place])
            if outcome in _FORM:
                self.add_refused(chunk[place], outcome, problem, count=False)

    def to_json(self) -> dict[str, Any]:
        """Return the counts; an event has the kind of its last update, and observed time no gap beyond max_gap_s."""
        kinds = self._kinds + Counter(self._open.values())
        hours = self._observed_us / _US_PER_HOUR
        shown = {
            "records": self._outcomes.total(),
            "outcomes": dict(sorted(self._outcomes.items())),
            "vehicles": len({vehicle for _, vehicle in self._last_us}),
            "vehicle_hours": round(hours, 6),
            "events": dict(sorted(kinds.items())),
            "alarms": kinds.total(),
            "alarms_per_vehicle_hour": round(kinds.total() / hours, 6) if hours else None,
            "sensor_quality": {
                vehicle: quality.model_dump(mode="json", exclude={"v", "site", "vehicle", "t_us"})
                for (_, vehicle), quality in sorted(self._qualities.items())
            },
        }
        return shown | self.truth.to_json()


class TruthScore:
    """Verdicts beside the ground truth of a data set, message by message."""

    def __init__(self) -> None:
        self._flagged: dict[tuple[str, str], bool] = {}
        """By receiver and message, for messages that the file has not labelled yet."""
        self._attacks: dict[str, bool] = {}
        self._counts: Counter[tuple[bool, bool]] = Counter()
        """By whether the message is an attack, and whether its verdict is anomalous."""

    def add_label(self, located: Located) -> None:
        """Take what a row of ground truth says of a message."""
        if located.truth is not None and located.truth.is_attack is not None:
            self._attacks[located.truth.message] = located.truth.is_attack

    def add_verdict(self, located: Located, *, is_anomalous: bool) -> None:
        """Take the verdict of a message."""
        if located.truth is None:
            return
        if located.truth.is_attack is None:
            self._flagged[located.drive, located.truth.message] = is_anomalous
        else:
            self._counts[located.truth.is_attack, is_anomalous] += 1

    def to_json(self) -> dict[str, Any]:
        """Return the scores as the field `truth`; nothing where there is no ground truth."""
        counts = self._counts.copy()
        for (_, message), is_anomalous in self._flagged.items():
            if message in self._attacks:
                counts[self._attacks[message], is_anomalous] += 1
        if not counts:
            return {}
        attacks, honest = counts[True, True] + counts[True, False], counts[False, True] + counts[False, False]
        return {
            "truth": {
                "messages": attacks + honest,
                "attacks": attacks,
                "recall": round(counts[True, True] / attacks, 6) if attacks else None,
                "false_positive_rate": round(counts[False, True] / honest, 6) if honest else None,
            }
        }


def show(summary: dict[str, Any]) -> None:
    """Print the summary for people."""
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
    _show_qualities(console, summary["sensor_quality"])
    if "truth" in summary:
        truth = summary["truth"]
        console.print(
            f"ground truth: {truth['attacks']:,} attacks in {truth['messages']:,} messages,"
            f" recall {_share(truth['recall'])}, false positives {_share(truth['false_positive_rate'])}"
        )


def _show_qualities(console: Console, qualities: dict[str, dict[str, Any]]) -> None:
    """Print how many vehicles have sensors of each level, and what the others' sensors are like."""
    if not qualities:
        return
    levels = Counter(quality["level"] for quality in qualities.values())
    console.print("sensors: " + ", ".join(f"{levels[level]:,} {level}" for level in QualityLevel))
    worse = {vehicle: found for vehicle, found in qualities.items() if found["level"] != QualityLevel.GOOD}
    if not worse:
        return
    names = [name for name in next(iter(worse.values())) if name != "level"]
    table = Table("vehicle", "sensors", *names)
    for vehicle, found in list(worse.items())[:_SHOWN_VEHICLES]:
        numbers = ("-" if found[name] is None else f"{found[name]:.2g}" for name in names)
        table.add_row(vehicle, found["level"], *numbers)
    console.print(table)
    if len(worse) > _SHOWN_VEHICLES:
        console.print(f"and {len(worse) - _SHOWN_VEHICLES:,} more, in --json")


def _share(value: float | None) -> str:
    return "-" if value is None else f"{value:.1%}"
