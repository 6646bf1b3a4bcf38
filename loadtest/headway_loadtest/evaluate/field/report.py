"""What `headway evaluate field` measured, as tables for the terminal and as Markdown."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.table import Table

from headway_loadtest.evaluate.field.causes import CAUSES, FAULTS_OF_THE_DATA

LEGEND = """\
An alarm is one event id. False alarms are those of the clean recordings; alarms within 4 s of a recorded gap are
counted apart, as "at gaps". A fault is found when an alarm of its vehicle has an alarming reading between its first
message and a second after its last; "by chance" is the recall that the alarms of the clean recording would have had.
Moving: above 3 m/s, with no recorded gap within 4 s."""


@dataclass(frozen=True, slots=True)
class Sheet:
    """A table: what it shows, its columns, its lines."""

    title: str
    header: tuple[str, ...]
    lines: Sequence[tuple[str, ...]]


def sheets(result: Mapping[str, Any]) -> Iterator[Sheet]:
    """Yield the tables that the result has values for."""
    rows = result["rows"]
    if rows:
        yield _false_alarms(_sets(rows))
        yield _causes(_sets(rows))
        yield _recall(rows)
    if result["degradations"]:
        yield _degradations(result["degradations"])
    if result["attacks"]:
        yield _attacks(result["attacks"])


def print_report(result: Mapping[str, Any], console: Console) -> None:
    """Print the tables."""
    for sheet in sheets(result):
        table = Table(title=sheet.title, title_justify="left", title_style="bold")
        for name in sheet.header:
            table.add_column(name, justify="right")
        for line in sheet.lines:
            table.add_row(*line)
        console.print(table)


def markdown(result: Mapping[str, Any]) -> str:
    """Return the tables as a document."""
    parts = ["# Field recordings", _settings(result), LEGEND]
    for sheet in sheets(result):
        parts += [f"## {sheet.title}", _pipes(sheet)]
    return "\n\n".join(parts) + "\n"


def number(value: float | None, digits: int = 2) -> str:
    """Return a number, or a dash where there was nothing to measure."""
    return "-" if value is None else f"{value:.{digits}f}"


def _settings(result: Mapping[str, Any]) -> str:
    return f"{result['runs']} runs, seed {result['seed']}, alarm budget {result['budget_per_hour']:g} per hour."


def _sets(rows: Sequence[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """Return one row of each set: what is clean does not depend on the severity."""
    return list({row["set"]: row for row in rows}.values())


def _false_alarms(rows: Sequence[Mapping[str, Any]]) -> Sheet:
    return Sheet(
        "False alarms of clean recordings",
        ("set", "vehicle h", "false", "per h", "moments/h", "moving per h", "link/pair-h", "at gaps", "by kind"),
        [
            (
                row["set"],
                number(row["vehicle_hours"]),
                str(row["false_alarms"]),
                number(row["false_alarms_per_hour"]),
                number(row["moments_per_hour"]),
                number(row["moving"]["false_alarms_per_hour"]),
                number(row["link_false_alarms_per_pair_hour"]),
                str(row["alarms_at_recording_gaps"]),
                _counts(row["false_alarms_by_kind"]),
            )
            for row in rows
        ],
    )


def _causes(rows: Sequence[Mapping[str, Any]]) -> Sheet:
    counted = [cause for cause in CAUSES if any(cause in row["false_alarms_by_cause"] for row in rows)]
    return Sheet(
        "What the recordings show at these alarms (* a fault of the data)",
        ("set", *(f"{cause}*" if cause in FAULTS_OF_THE_DATA else cause for cause in counted)),
        [(row["set"], *(str(row["false_alarms_by_cause"].get(cause, 0)) for cause in counted)) for row in rows],
    )


def _recall(rows: Sequence[Mapping[str, Any]]) -> Sheet:
    kinds = ("short", "noise", "bias", "drift")
    return Sheet(
        "Injected faults found",
        ("set", "c", "faults", "recall", "by chance", *kinds, "sensor", "kind right", "delay [s]", "moving recall"),
        [
            (
                row["set"],
                f"{row['severity']:g}",
                str(row["faults"]),
                number(row["recall"], 3),
                number(row["recall_by_chance"], 3),
                *(number(row["recall_by_kind"].get(kind)) for kind in kinds),
                number(row["sensor_correct"]),
                number(row["kind_correct"]),
                number(row["time_to_detect_s"]),
                number(row["moving"]["recall"], 3),
            )
            for row in rows
        ],
    )


def _degradations(rows: Sequence[Mapping[str, Any]]) -> Sheet:
    return Sheet(
        "Alarms of honest senders with ordinary defects; position jumps are faults to find",
        ("set", "degradation", "vehicle h", "alarms", "per h", "moments/h", "jumps found", "by kind"),
        [
            (
                row["set"],
                row["degradation"],
                number(row["vehicle_hours"]),
                str(row["alarms"]),
                number(row["alarms_per_hour"]),
                number(row["moments_per_hour"]),
                number(row["jump_recall"], 3),
                _counts(row["alarms_by_kind"]),
            )
            for row in rows
        ],
    )


def _attacks(rows: Sequence[Mapping[str, Any]]) -> Sheet:
    return Sheet(
        "Attackers: a message is found while an open event names its sender (CaTCH: published, VeReMi-NextGen)",
        (
            *("set", "attack", "onset", "message recall", "CaTCH", "false positives", "CaTCH", "attackers named"),
            *("suspect right", "honest cars named"),
        ),
        [
            (
                row["set"],
                row["attack"],
                row["onset"],
                number(row["message_recall"], 3),
                number(row["catch_message_recall"]),
                number(row["false_positive_rate"], 4),
                number(row["catch_false_positive_rate"], 3),
                number(row["event_recall"]),
                number(row["suspect_correct"]),
                f"{row['honest_cars_named']} of {row['honest_cars']}",
            )
            for row in rows
        ],
    )


def _counts(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{word} {count}" for word, count in counts.items())


def _pipes(sheet: Sheet) -> str:
    lines = (sheet.header, ["---:"] * len(sheet.header), *sheet.lines)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
