"""What `run_pairs` returned, for the terminal and as Markdown."""

from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

Rows = Sequence[Sequence[str]]
HEADER = (
    "set",
    "model",
    "tau [s]",
    "c",
    "kind",
    "AUC",
    "ceiling",
    "share",
    "recall",
    "false/h",
    "delay [s]",
    "sensor",
    "kind right",
    "x rec./corr.",
    "v rec./corr.",
)
MISBEHAVIOUR_TITLE = "Senders that keep location and speed consistent (tests between two cars)"
MISBEHAVIOUR_HEADER = ("set", "kind", "range", "events", "recall at 2 %", "at budget", "suspect right", "false/h")
CLEAN_HEADER = ("set", "model", "tau [s]", "false alarms", "hours", "per hour")
LEGEND = """\
The ceiling is the AUC of |z - truth|^2, a memoryless detector that knows the true state; share is
(AUC - 1/2) / (ceiling - 1/2). An event is found if an alarm stands between its first sample and a second after its
last. `headway` learns its gate from the budget; the others get the lowest gate that keeps the budget on the clean
drives of their set, which no service could know. The last two columns are the RMSE of the recovered readings over that
of the corrupted ones, over the faulty samples."""
KINDS = ("short", "noise", "bias", "drift")


def rows(result: Mapping[str, Any]) -> Rows:
    """One line per set, model, delay, severity and kind."""
    return [
        (
            row["set"],
            row["model"],
            f"{row['delay_s']:g}",
            f"{row['severity']:g}",
            row["kind"],
            f"{_number(row['auc'])} ±{_number(row['auc_std'])}",
            *(_number(row[name]) for name in ("ceiling", "share_of_ceiling", "recall_at_budget")),
            _number(row["false_alarms_per_hour"], 2),
            _number(row["detection_delay_s"], 1),
            *(_number(row[name], 2) for name in ("sensor_correct", "kind_correct")),
            *(_number(row[name]) for name in ("recovered_share_location", "recovered_share_speed")),
        )
        for row in result["rows"]
    ]


def clean_rows(result: Mapping[str, Any]) -> Rows:
    """One line per set, model and delay."""
    return [
        (
            row["set"],
            row["model"],
            f"{row['delay_s']:g}",
            str(row["false_alarms"]),
            f"{row['hours']:.2f}",
            _number(row["false_alarms_per_hour"], 2),
        )
        for row in result["clean"]
    ]


def confusion_rows(result: Mapping[str, Any], model: str) -> Rows:
    """Return counts over every row of the model: injected kinds down, kinds named last across."""
    counts = {true: dict.fromkeys(KINDS, 0) for true in KINDS}
    for row in result["rows"]:
        if row["model"] == model:
            for true, named in row["confusion"].items():
                for kind, count in named.items():
                    counts[true][kind] += count
    return [(true, *(str(counts[true][kind]) for kind in KINDS)) for true in KINDS]


def misbehaviour_rows(result: Mapping[str, Any]) -> Rows:
    """Return a line for each set, kind and forward sensor."""
    return [
        (
            row["set"],
            row["injection"],
            "yes" if row["with_range"] else "no",
            str(row["lies"]),
            *(
                _number(row[name], 2)
                for name in ("recall_at_2pct_windows", "recall_at_budget", "suspect_correct", "false_alarms_per_hour")
            ),
        )
        for row in result.get("liars", ())
    ]


def print_report(result: Mapping[str, Any], console: Console) -> None:
    """Print the tables."""
    console.print(_table(_title(result), HEADER, rows(result)))
    console.print(_table("False alarms on clean drives", CLEAN_HEADER, clean_rows(result)))
    for model in _models(result):
        console.print(_table(f"Kinds, {model}", ("injected", *KINDS), confusion_rows(result, model)))
    console.print(_table(MISBEHAVIOUR_TITLE, MISBEHAVIOUR_HEADER, misbehaviour_rows(result)))


def markdown(result: Mapping[str, Any], figures: Mapping[str, str]) -> str:
    """Return the tables and the figures (file name to caption) as a document."""
    parts = [
        "# Real pairs",
        _title(result),
        LEGEND,
        _pipes(HEADER, rows(result)),
        "## False alarms on clean drives",
        _pipes(CLEAN_HEADER, clean_rows(result)),
        "## Kinds",
        "Injected down, named last across; detected events with the right sensor.",
    ]
    for model in _models(result):
        parts += [f"### {model}", _pipes(("injected", *KINDS), confusion_rows(result, model))]
    parts += [f"## {MISBEHAVIOUR_TITLE}", _pipes(MISBEHAVIOUR_HEADER, misbehaviour_rows(result))]
    parts += ["## Figures", *(f"![{caption}]({name})\n\n{caption}." for name, caption in figures.items())]
    return "\n\n".join(parts) + "\n"


def _models(result: Mapping[str, Any]) -> list[str]:
    return list(dict.fromkeys(row["model"] for row in result["rows"]))


def _title(result: Mapping[str, Any]) -> str:
    return (
        f"{result['runs']} runs, seed {result['seed']}, budget {result['budget_per_hour']:g} false alarms per pair-hour"
    )


def _number(value: float | None, digits: int = 3) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _table(title: str, header: Sequence[str], lines: Rows) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in header:
        table.add_column(name, justify="right")
    for line in lines:
        table.add_row(*line)
    return table


def _pipes(header: Sequence[str], lines: Rows) -> str:
    return "\n".join(f"| {' | '.join(line)} |" for line in (header, ["---:"] * len(header), *lines))
