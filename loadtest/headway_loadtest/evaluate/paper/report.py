"""The published tables beside what came out, for the terminal and as Markdown."""

from collections.abc import Mapping, Sequence

from rich.console import Console
from rich.table import Table

from headway_loadtest.evaluate.paper.experiment import (
    DELAYS_S,
    DEVIATIONS,
    MODELS,
    SEVERITIES,
    DefaultRow,
    PaperResult,
    Table1Row,
)

Rows = Sequence[Sequence[str]]
TABLE1_HEADER = ("c", "tau [s]", "Model 1 (ekf)", "paper", "Model 2 (aekf)", "paper", "p")
DEFAULT_HEADER = ("c", "tau [s]", "headway", "Model 2, paper")
DEFAULT_TITLE = "The default model on the same drives: AUC without an oracle"
TABLE2_HEADER = ("model", "tau [s]", "nu_x [m]", "paper", "nu_v [m/s]", "paper", "MSE", "paper", "repairs")


def table1_rows(result: PaperResult) -> Rows:
    """One row per severity and delay: mean AUC, its deviation over the runs, and the printed value, for both models."""
    cells = {(row.model, row.delay_s, row.severity): row for row in result.table1}
    return [
        (
            f"{severity:g}",
            f"{delay_s:g}",
            *(text for model in MODELS for text in _auc(cells[model, delay_s, severity])),
            _p_value(cells["ekf", delay_s, severity].p_value),
        )
        for severity in SEVERITIES
        for delay_s in DELAYS_S
    ]


def default_rows(result: PaperResult) -> Rows:
    """One row per severity and delay: mean AUC of the service's default model beside the printed Model 2."""
    cells = {(row.delay_s, row.severity): row for row in result.default}
    rows = [cells[delay_s, severity] for severity in SEVERITIES for delay_s in DELAYS_S]
    return [(f"{row.severity:g}", f"{row.delay_s:g}", *_auc(row)) for row in rows]


def table2_rows(result: PaperResult) -> Rows:
    """One row per model and delay: mean innovations and MSE on clean drives, each with the printed value."""
    return [
        (
            row.model,
            f"{row.delay_s:g}",
            *(
                text
                for found, printed in zip((row.innovation_m, row.innovation_mps, row.mse), row.printed, strict=True)
                for text in (f"{found:.3f}", f"{round(printed, 4):g}")
            ),
            f"{row.repaired_share:.3%}",
        )
        for row in result.table2
    ]


def print_report(results: Sequence[PaperResult], console: Console) -> None:
    """Print Table 1 of each result and what no recovery touches, once."""
    for result in results:
        console.print(_table(f"Table 1: AUC. {describe(result)}", TABLE1_HEADER, table1_rows(result)))
        console.print(f"Mean absolute deviation from the 18 printed cells: {result.mean_absolute_deviation:.3f}\n")
    console.print(_table(DEFAULT_TITLE, DEFAULT_HEADER, default_rows(results[0])))
    console.print(_table("Table 2: clean drives, mean innovation and error", TABLE2_HEADER, table2_rows(results[0])))


def describe(result: PaperResult) -> str:
    """Return in a line what was run."""
    p = result.protocol
    jitter = f", delay jitter {p.delay_jitter_s:g} s" if p.delay_jitter_s else ""
    return (
        f"Recovery: {p.recovery}, history: {p.history}{jitter}; "
        f"{result.samples} samples, seeds {p.seeds[0]} to {p.seeds[-1]}"
    )


def markdown(results: Sequence[PaperResult], figures: Mapping[str, str]) -> str:
    """Return Table 1 of each result, Table 2, the figures (file name to caption) and the deviations as a document."""
    parts = ["# The published experiment, reproduced"]
    for result in results:
        parts += [
            f"## {describe(result)}",
            f"Table 1: AUC, mean and deviation over {result.protocol.runs} runs; p: paired t-test between the models.",
            _pipes(TABLE1_HEADER, table1_rows(result)),
            f"Mean absolute deviation from the 18 printed cells: {result.mean_absolute_deviation:.3f}.",
        ]
    parts += [f"## {DEFAULT_TITLE}", _pipes(DEFAULT_HEADER, default_rows(results[0]))]
    parts += [
        "## Clean drives",
        "Table 2: mean innovation, the root of the sum of both states' mean squared errors, repairs of P per reading.",
        _pipes(TABLE2_HEADER, table2_rows(results[0])),
        "## Figures",
    ]
    parts += [f"![{caption}]({name})\n\n{caption}." for name, caption in figures.items()]
    parts += ["## Where the protocol departs from the paper's text"]
    parts += ["\n".join(f"- **{name}**: {text}." for name, text in DEVIATIONS.items())]
    return "\n\n".join(parts) + "\n"


def _auc(row: Table1Row | DefaultRow) -> tuple[str, str]:
    spread = "" if row.auc_std is None else f" ±{row.auc_std:.3f}"
    return f"{row.auc:.3f}{spread}", f"{row.printed:.3f}"


def _p_value(p: float | None) -> str:
    return "" if p is None else f"{p:.1g}"


def _table(title: str, header: Sequence[str], rows: Rows) -> Table:
    table = Table(title=title, title_justify="left", title_style="bold")
    for name in header:
        table.add_column(name, justify="right", style="dim" if name == "paper" else None)
    for row in rows:
        table.add_row(*row)
    return table


def _pipes(header: Sequence[str], rows: Rows) -> str:
    lines = (header, ["---:"] * len(header), *rows)
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
