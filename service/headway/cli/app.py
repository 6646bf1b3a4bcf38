"""The commands; wiring only. Each imports what it runs when it runs, so that the light ones start at once."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from headway.errors import UserError
from headway.version import version

app = typer.Typer(no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False)
config_app = typer.Typer(no_args_is_help=True, help="Settings: effective values, a check, their schema.")
app.add_typer(config_app, name="config")
alerts_app = typer.Typer(no_args_is_help=True, help="The journal of a service: what it said of whom.")
app.add_typer(alerts_app, name="alerts")
evaluate_app = typer.Typer(no_args_is_help=True, help="Offline experiments with the service's own core.")
app.add_typer(evaluate_app, name="evaluate")

ConfigFile = Annotated[Path | None, typer.Option("--config", help="TOML file of settings; HEADWAY_* wins over it.")]
Connect = Annotated[
    list[str] | None, typer.Option("--connect", help="zenoh endpoint of the service or a router; may be repeated.")
]
Sites = Annotated[list[str] | None, typer.Option("--site", help="Site to show; may be repeated.")]
ZenohConfig = Annotated[Path | None, typer.Option(help="JSON5 file of zenoh's own options, such as certificates.")]
JournalFile = Annotated[
    Path | None, typer.Option("--journal", help="Journal of a service; by default that of state_dir.")
]
From = Annotated[str | None, typer.Option("--from", help="Detected at this time (ISO 8601, UTC) or later.")]
To = Annotated[str | None, typer.Option(help="Detected before this time.")]
OfKind = Annotated[str | None, typer.Option("--kind", help="One kind, such as bias.")]
OfPhase = Annotated[str | None, typer.Option("--phase", help="onset, update or cleared; onset gives a line for each.")]
OfVehicle = Annotated[str | None, typer.Option("--vehicle", help="Suspect, follower or leader.")]
AsJson = Annotated[bool, typer.Option("--json", help="One JSON object on standard output and nothing else.")]


DEFAULT_SITES = ["local"]


def main() -> None:
    """Run the command line; end with status 2 and one line when the user can mend it."""
    try:
        app()
    except UserError as error:
        sys.stderr.write(f"headway: {error}\n")
        sys.exit(2)


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"headway {version()}")
        raise typer.Exit


@app.callback()
def root(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print it and exit.")
    ] = False,
) -> None:
    """Find which reading, of which sensor, of which car, cannot be true."""


@app.command()
def serve(config: ConfigFile = None) -> None:
    """Judge the messages on the bus until SIGTERM or SIGINT."""
    from headway.cli import serve as service
    from headway.settings import load

    service.serve(load(config))


@app.command()
def demo(
    pairs: Annotated[int, typer.Option(min=1, max=2000, help="Pairs of cars.")] = 24,
    seconds: Annotated[float, typer.Option(min=10, max=3600, help="How long they drive.")] = 40.0,
    as_json: AsJson = False,
) -> None:
    """Service and replay in one go, no router needed; ends with a report."""
    from headway.cli import loadtest

    loadtest.demo(pairs=pairs, seconds=seconds, as_json=as_json)


@app.command()
def replay(
    sources: Annotated[list[str], typer.Argument(help="An SPMD folder, pair CSV files, or synthetic:N.")],
    site: Annotated[str, typer.Option(help="Site whose keys to use.")] = "local",
    speed: Annotated[float, typer.Option(min=0.01, help="Times real time; above 1 the service needs max_age_s.")] = 1.0,
    inject: Annotated[str | None, typer.Option(help="Anomalies, such as c=1,p=0.005,kinds=noise+bias+drift.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="The same seed replays the same.")] = 0,
    connect: Annotated[str, typer.Option(help="zenoh endpoint of the service or a router.")] = "tcp/127.0.0.1:7447",
    seconds: Annotated[float, typer.Option(min=1, help="Stop after so long; a synthetic fleet drives so long.")] = 600,
) -> None:
    """Replay drives to a running service, in real time or faster, with injected anomalies."""
    from headway.cli import loadtest

    loadtest.replay(sources, site=site, speed=speed, inject=inject, seed=seed, endpoint=connect, seconds=seconds)


@app.command()
def loadtest(
    vehicles: Annotated[
        int, typer.Option(min=1, help="Synthetic vehicles; with --find-limit, the most to try.")
    ] = 1000,
    seconds: Annotated[float, typer.Option(min=5, help="How long to measure, after 5 s of warm-up.")] = 30.0,
    rate_hz: Annotated[float, typer.Option(min=1, max=10, help="Messages of each vehicle per second.")] = 10.0,
    bundle: Annotated[int, typer.Option(min=1, max=512, help="Records per payload.")] = 1,
    burst: Annotated[bool, typer.Option(help="Everybody sends at the same instant.")] = False,
    rotate_s: Annotated[float, typer.Option(min=1, help="Each vehicle takes a new id this often.")] = float("inf"),
    surge: Annotated[
        int, typer.Option(min=0, help="So many vehicles more for those seconds, then the usual ones again.")
    ] = 0,
    find_limit: Annotated[bool, typer.Option(help="Find the most vehicles that meet the targets.")] = False,
    as_json: AsJson = False,
) -> None:
    """Measure latency, loss and cost of a service in a process of its own; exit 1 when a target is missed."""
    from headway.cli import loadtest

    if find_limit:
        raise typer.Exit(loadtest.find_limit(vehicles_max=vehicles, rate_hz=rate_hz, bundle=bundle, as_json=as_json))
    missed = loadtest.loadtest(
        vehicles=vehicles,
        seconds=seconds,
        rate_hz=rate_hz,
        bundle=bundle,
        burst=burst,
        rotate_s=rotate_s,
        surge=surge,
        as_json=as_json,
    )
    raise typer.Exit(missed)


@app.command()
def watch(
    connect: Connect = None,
    site: Sites = None,
    zenoh_config: ZenohConfig = None,
    as_json: Annotated[bool, typer.Option("--json", help="JSON objects, one a line.")] = False,
) -> None:
    """Show alerts, pairs and health in the terminal; plain lines where there is none."""
    from headway.dashboard import DashboardError
    from headway.dashboard import watch as view

    try:
        view.watch(
            connect=_endpoints(connect, zenoh_config),
            sites=site or DEFAULT_SITES,
            zenoh_config=zenoh_config,
            as_json=as_json,
        )
    except DashboardError as error:
        raise UserError(str(error)) from None


@app.command()
def dashboard(
    connect: Connect = None,
    site: Sites = None,
    zenoh_config: ZenohConfig = None,
    host: Annotated[str, typer.Option(help="Address of the page; beyond loopback a token is needed.")] = "127.0.0.1",
    port: Annotated[int, typer.Option(min=0, max=65_535, help="Port of the page; 0 takes a free one.")] = 8080,
    token_file: Annotated[Path | None, typer.Option(help="File with the token that opens the page.")] = None,
    name: Annotated[list[str] | None, typer.Option(help="Further host name of the page; may be repeated.")] = None,
) -> None:
    """Serve a web page of alerts, pairs and health."""
    from headway.dashboard import DashboardError

    try:
        from headway.dashboard import server
    except ModuleNotFoundError as error:
        raise UserError(f"the page needs {error.name}: pip install 'headway[dashboard]'") from None
    try:
        server.serve(
            connect=_endpoints(connect, zenoh_config),
            sites=site or DEFAULT_SITES,
            host=host,
            port=port,
            token_file=token_file,
            names=name or (),
            zenoh_config=zenoh_config,
        )
    except DashboardError as error:
        raise UserError(str(error)) from None


def _endpoints(connect: list[str] | None, zenoh_config: Path | None) -> list[str]:
    """Return what was asked for; else leave it to the file; else the service on this machine."""
    return connect or ([] if zenoh_config else ["tcp/127.0.0.1:7447"])


@alerts_app.command(name="list")
def list_alerts(
    journal: JournalFile = None,
    from_time: From = None,
    to: To = None,
    kind: OfKind = None,
    phase: OfPhase = None,
    vehicle: OfVehicle = None,
    limit: Annotated[int, typer.Option(min=1, max=1000, help="The newest so many.")] = 20,
    as_json: AsJson = False,
) -> None:
    """Print the newest statements, the last one last."""
    from headway.cli import alerts

    asked = alerts.query(from_time=from_time, to_time=to, kind=kind, phase=phase, vehicle=vehicle, limit=limit)
    alerts.show(alerts.journal_file(journal), asked, as_json=as_json)


@alerts_app.command()
def export(
    out: Annotated[Path | None, typer.Argument(help="File to write; by default standard output.")] = None,
    journal: JournalFile = None,
    from_time: From = None,
    to: To = None,
    kind: OfKind = None,
    phase: OfPhase = None,
    vehicle: OfVehicle = None,
    form: Annotated[str, typer.Option("--format", help="jsonl with evidence; csv or parquet without.")] = "jsonl",
) -> None:
    """Write every statement, oldest first."""
    from headway.cli import alerts

    writers: dict[str, alerts.Writer] = {"jsonl": alerts.write_lines, "csv": alerts.write_csv}
    if form == "parquet":
        if out is None:
            raise UserError("--format parquet is no text: name a file to write")
        try:
            from headway.cli.alerts_parquet import write_parquet
        except ModuleNotFoundError as error:
            raise UserError(f"--format parquet needs {error.name}: pip install 'headway[parquet]'") from None
        writers[form] = write_parquet
    if form not in writers:
        raise UserError(f"--format {form}: choose jsonl, csv or parquet")
    asked = alerts.query(
        from_time=from_time, to_time=to, kind=kind, phase=phase, vehicle=vehicle, evidence=form == "jsonl"
    )
    count = alerts.export(alerts.journal_file(journal), asked, writers[form], out)
    typer.echo(f"{count} statements", err=True)


@app.command()
def explain(
    event_id: Annotated[str, typer.Argument(help="As alerts carry it and `headway alerts list` shows it.")],
    journal: JournalFile = None,
    connect: Annotated[str | None, typer.Option(help="zenoh endpoint of a service to ask instead of a file.")] = None,
    site: Annotated[str, typer.Option(help="Site to ask there.")] = "local",
    plot: Annotated[Path | None, typer.Option(help="PNG or SVG file of readings, expectations and verdicts.")] = None,
    as_json: AsJson = False,
) -> None:
    """Judge the evidence of an event again and compare, number by number; exit 1 when one differs."""
    from rich.console import Console

    from headway.explain import compare as again

    explained = again.explain(event_id, journal=journal, connect=connect, site=site)
    if plot is not None:
        try:
            from headway.explain.plot import draw
        except ModuleNotFoundError as error:
            raise UserError(f"--plot needs {error.name}: pip install 'headway[plots]'") from None
        draw(explained, plot)
    if as_json:
        typer.echo(json.dumps(again.to_json(explained)))
    else:
        again.show(explained, Console())
    raise typer.Exit(0 if again.same(explained) else 1)


@evaluate_app.command()
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
    """Run the published experiment, its two tables beside the printed values."""
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


@evaluate_app.command()
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
    """Run every model on real pairs with injected anomalies, and the consistent liars."""
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


@evaluate_app.command()
def field(
    sources: Annotated[list[str], typer.Argument(help="Recordings (CSV, BSM JSON lines), or folders of them.")],
    severity: Annotated[str, typer.Option(help="Variances of the injected faults, apart by commas.")] = "1,0.5,0.1",
    runs: Annotated[int, typer.Option(min=1, max=100, help="Realisations of faults and noise.")] = 3,
    seed: Annotated[int, typer.Option(min=0, help="The same seed gives the same result.")] = 0,
    budget: Annotated[float, typer.Option(help="False alarms per vehicle and hour.")] = 1.0,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; by default one for each core.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for a Markdown report and the JSON.")] = None,
    as_json: AsJson = False,
) -> None:
    """Judge recordings of real senders, clean and with injected faults, with the service's own engine."""
    from headway_loadtest.evaluate.field.command import evaluate_field
    from headway_loadtest.evaluate.field.experiment import FieldProtocol

    protocol = FieldProtocol(severities=_numbers("--severity", severity), runs=runs, seed=seed, budget_per_hour=budget)
    raise typer.Exit(evaluate_field(sources, protocol, as_json=as_json, out=out, processes=jobs))


def _numbers(option: str, text: str) -> tuple[float, ...]:
    try:
        return tuple(float(word) for word in text.split(","))
    except ValueError:
        raise UserError(f"{option} takes numbers apart by commas, not '{text}'") from None


@config_app.command()
def show(config: ConfigFile = None, as_json: AsJson = False) -> None:
    """Print the effective settings and where each comes from."""
    from headway.settings import load

    loaded = load(config)
    values = loaded.settings.model_dump(mode="json")
    if as_json:
        typer.echo(json.dumps({name: {"value": v, "origin": loaded.origins[name]} for name, v in values.items()}))
        return
    width = max(map(len, values))
    for name, value in values.items():
        typer.echo(f"{name:<{width}}  {json.dumps(value):<24}  {loaded.origins[name]}")


@config_app.command()
def check(config: ConfigFile = None) -> None:
    """Say whether the service would start with these settings."""
    from headway.settings import Origin, load

    origins = list(load(config).origins.values())
    typer.echo("settings are right: " + ", ".join(f"{origins.count(o)} from {o}" for o in Origin))


@config_app.command()
def schema() -> None:
    """Print the JSON Schema of the settings."""
    from headway.settings import Settings

    typer.echo(json.dumps(Settings.model_json_schema(), indent=2))
