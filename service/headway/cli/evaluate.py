"""`headway evaluate`: offline experiments with the service's own core."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from headway.cli.options import AsJson, options_as
from headway.errors import UserError

app = typer.Typer(no_args_is_help=True, help="Offline experiments with the service's own core.")


@app.command()
def paper(
    leader: Annotated[Path, typer.Option(help="CSV of the leader's drive: t_s, x_m, v_mps at 10 Hz.")],
    runs: Annotated[int, typer.Option(min=1, max=1000, help="Seeds to average over.")] = 20,
    recovery: Annotated[str, typer.Option(help="ground-truth as published, or prediction as a service can.")] = (
        "ground-truth"
    ),
    history: Annotated[str, typer.Option(help="constant as the published solver, or buffers as the equations.")] = (
        "constant"
    ),
    delay_jitter: Annotated[float, typer.Option(min=0, help="Standard deviation of the stochastic delay, s.")] = 0.0,
    seed: Annotated[int, typer.Option(min=0, help="First seed.")] = 1,
    out: Annotated[Path | None, typer.Option(help="Folder for a Markdown report with figures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Run the published experiment, its two tables beside the printed values.

    Example: headway evaluate paper --leader leader.csv --runs 20
    """
    from headway_loadtest.evaluate.paper.command import evaluate_paper
    from headway_loadtest.evaluate.paper.experiment import Protocol
    from headway_loadtest.evaluate.paper.loop import History, Recovery

    if recovery not in list(Recovery):
        raise UserError(f"--recovery {recovery}: choose from {', '.join(Recovery)}")
    if history not in list(History):
        raise UserError(f"--history {history}: choose from {', '.join(History)}")
    protocol = Protocol(
        runs=runs, recovery=Recovery(recovery), history=History(history), delay_jitter_s=delay_jitter, seed=seed
    )
    raise typer.Exit(evaluate_paper(leader, protocol, as_json=as_json, out=out))


@app.command()
def pairs(
    paths: Annotated[list[Path], typer.Argument(help="Pair CSV files, or folders of them; a folder is a set.")],
    models: Annotated[str, typer.Option(help="Models, apart by commas.")] = "ca,ekf,aekf,headway",
    delay: Annotated[str, typer.Option(help="Delays, s, apart by commas.")] = "0,0.5,1.5",
    severity: Annotated[str, typer.Option(help="Variances of the anomalies, apart by commas.")] = "1,0.5,0.1",
    kinds: Annotated[str, typer.Option(help="all, or kinds apart by commas.")] = "all",
    runs: Annotated[int, typer.Option(min=1, max=100, help="Drives of each pair.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same result.")] = 0,
    budget: Annotated[float, typer.Option(help="False alarms per pair and hour.")] = 1.0,
    out: Annotated[Path | None, typer.Option(help="Folder for a Markdown report with figures.")] = None,
    as_json: AsJson = False,
) -> None:
    """Run every model on real pairs with injected anomalies, and consistent falsifications.

    Example: headway evaluate pairs pairs/ --delay 0.5 --severity 1
    """
    from headway_loadtest.evaluate.pairs.command import evaluate_pairs
    from headway_loadtest.evaluate.pairs.experiment import PairsProtocol

    protocol = PairsProtocol(
        models=tuple(models.split(",")),
        delays_s=_numbers("--delay", delay),
        severities=_numbers("--severity", severity),
        kinds=tuple(kinds.split(",")),
        runs=runs,
        seed=seed,
        budget_per_hour=budget,
    )
    raise typer.Exit(evaluate_pairs(paths, protocol, as_json=as_json, out=out))


@dataclass(frozen=True)
class FieldOptions:
    """The options of `headway evaluate field` that say what is played."""

    severity: Annotated[str, typer.Option(help="Variances of the injected faults, apart by commas.")] = "1,0.5,0.1"
    degrade: Annotated[bool, typer.Option("--degrade", help="Ordinary defects of receivers and channels too.")] = False
    attacks: Annotated[bool, typer.Option("--attacks", help="All attacks of F2MD and VeReMi-NextGen too.")] = False
    attack: Annotated[list[str] | None, typer.Option(help="One attack; may be repeated.")] = None
    minutes: Annotated[float, typer.Option(min=0.5, max=120, help="How long simulated traffic lasts.")] = 5.0
    runs: Annotated[int, typer.Option(min=1, max=100, help="Realisations of faults and noise.")] = 3
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same result.")] = 0
    budget: Annotated[float, typer.Option(help="False alarms per vehicle and hour.")] = 1.0


@app.command()
@options_as(FieldOptions)
def field(
    sources: Annotated[
        list[str], typer.Argument(help="Recordings of any format, folders of them, or sumo[:SCENARIO-DRIVER].")
    ],
    options: FieldOptions,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each core.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a Markdown report and the JSON.")] = None,
    as_json: AsJson = False,
) -> None:
    """Judge recordings of real senders and simulated traffic with the service's own engine.

    Example: headway evaluate field recordings/ --out report
    """
    from headway.cli.run.recorded.field_reader import FieldReader
    from headway_loadtest.evaluate.field.attacks import ATTACKS
    from headway_loadtest.evaluate.field.command import evaluate_field
    from headway_loadtest.evaluate.field.experiment import FieldProtocol

    protocol = FieldProtocol(
        severities=_numbers("--severity", options.severity),
        runs=options.runs,
        seed=options.seed,
        budget_per_hour=options.budget,
        degrade=options.degrade,
        attacks=tuple(ATTACKS) if options.attacks else tuple(options.attack or ()),
    )
    code = evaluate_field(
        sources, protocol, minutes=options.minutes, as_json=as_json, out=out, processes=jobs, reader=FieldReader()
    )
    raise typer.Exit(code)


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise UserError(f"{option} takes numbers apart by commas, not '{text}'") from None
