"""A service in a process of its own under a synthetic load, held against the targets for that load."""

import json
import tempfile
from dataclasses import dataclass, replace
from math import ceil, inf, isfinite
from pathlib import Path

import typer
from rich.console import Console

from headway.cli.run.progress import in_one_line, progress_bar
from headway.cli.run.service_process import PREFIX, running_service, scraping
from headway_loadtest import run as runs
from headway_loadtest.inject.faults import ALGORITHM_1, Spec
from headway_loadtest.measure.report import Targets, missed_targets, show, to_json
from headway_loadtest.measure.result import Outcome
from headway_loadtest.traffic.fleet import FleetFrames
from headway_loadtest.traffic.session import connect
from headway_loadtest.traffic.surge import Surge
from headway_schemas.keys import Keys

LOAD_INJECTION = Spec(c=1.0, kinds=ALGORITHM_1, share=0.01)
"""One vehicle in a hundred lies, so that events flow while latency is measured."""

NOMINAL_HZ = 10.0
LOAD_WARMUP_S = 5.0
VEHICLE_TTL_S = 30.0
SCRAPE_EVERY_S = 1.0
SPARE_ROWS = 1.2

FEW_TARGETS = Targets(p50_ms=2.0, p99_ms=5.0, service_cpu_percent=25.0)
"""What the loop costs while it waits is shared by few messages: the bound is on a core, not on a message."""
TARGETS = (
    (250, FEW_TARGETS),
    (1_000, Targets(p50_ms=2.0, p99_ms=5.0, service_cpu_us=40.0)),
    (5_000, Targets(p50_ms=3.0, p99_ms=8.0, service_cpu_us=14.0)),
    (8_000, Targets(p50_ms=5.0, p99_ms=15.0, service_cpu_us=11.0)),
)
"""Single messages: what up to so many vehicles at 10 Hz must meet on two cores, the generator included."""
SURGE_LEAD_S, SURGE_AFTER_S = 10.0, 10.0
"""Of the usual load, before a surge and after it."""
SURGE_TARGETS = Targets(surge_p99_ms=2_000.0, recovered_s=5.0)
SOAK_TARGETS = Targets(rss_growth=0.05)
BUNDLE_TARGETS = Targets(p50_ms=5.0, p99_ms=20.0, service_cpu_us=5.0, rss_mb=600.0)

LIMIT_START, LIMIT_STEP_SHARE, LIMIT_SECONDS = 500, 0.05, 15.0


@dataclass(frozen=True, slots=True)
class Load:
    """What is put on the service."""

    vehicles: int
    seconds: float
    rate_hz: float = NOMINAL_HZ
    bundle: int = 1
    burst: bool = False
    rotate_s: float = inf
    surge: int = 0
    """So many vehicles more for `seconds`, with the usual load before and after."""


def loadtest(load: Load, *, config: Path | None, as_json: bool) -> int:
    """Measure one load against the targets for its size; return 1 when one is missed, else 0."""
    console = Console(stderr=as_json)
    outcome, targets = _carry(load, config, console), targets_for(load)
    if as_json:
        typer.echo(json.dumps(to_json(outcome, targets)))
    else:
        show(outcome, console)
        for missed in missed_targets(outcome, targets):
            console.print(f"[red]target missed:[/] {missed}")
    return 1 if missed_targets(outcome, targets) else 0


def find_limit(most: Load, *, config: Path | None, as_json: bool) -> int:
    """Find the most vehicles, up to those of `most`, that meet the targets, by bisection; return 1 when none do."""
    console = Console(stderr=as_json)
    low, high, tried = 0, most.vehicles, []
    vehicles = min(LIMIT_START, high)
    while high - low > max(1, LIMIT_STEP_SHARE * low):
        load = replace(most, vehicles=vehicles)
        outcome, targets = _carry(load, config, console), targets_for(load)
        missed = missed_targets(outcome, targets)
        tried.append(to_json(outcome, targets))
        console.print(f"{vehicles} vehicles: {'; '.join(missed) or 'all targets met'}")
        low, high = (low, vehicles) if missed else (vehicles, high)
        vehicles = min(2 * vehicles, high) if high == most.vehicles and not missed else (low + high) // 2
        if vehicles <= low:
            break
    if as_json:
        typer.echo(json.dumps({"limit_vehicles": low, "limit_hz": most.rate_hz * low, "tried": tried}))
    else:
        console.print(
            f"[bold]{low}[/] vehicles ({most.rate_hz * low:,.0f} messages a second) is the most that met the targets."
        )
    return 0 if low else 1


def targets_for(load: Load) -> Targets:
    """Return what the service must meet under a load, by its messages a second."""
    if load.surge:
        return SURGE_TARGETS
    if isfinite(load.rotate_s):
        return SOAK_TARGETS
    nominal = load.vehicles * load.rate_hz / NOMINAL_HZ
    if load.bundle > 1 and nominal > TARGETS[0][0]:
        return BUNDLE_TARGETS
    return next((targets for size, targets in TARGETS if nominal <= size), TARGETS[-1][1])


def _carry(load: Load, config: Path | None, console: Console) -> Outcome:
    """Run the service in a process of its own under a load."""
    capacity = max(1_000, ceil(SPARE_ROWS * load.vehicles * (1 + VEHICLE_TTL_S / load.rotate_s)) + load.surge)
    settings = {"site": "load", "vehicle_capacity": capacity, "vehicle_ttl_s": VEHICLE_TTL_S}
    surge, total_s = None, load.seconds + LOAD_WARMUP_S
    if load.surge:
        surge = Surge(vehicles=load.surge, start_s=LOAD_WARMUP_S + SURGE_LEAD_S, seconds=load.seconds)
        total_s = surge.stop_s + SURGE_AFTER_S
    frames = FleetFrames(
        load.vehicles,
        total_s,
        inject=LOAD_INJECTION,
        burst=load.burst,
        rotate_s=load.rotate_s,
        step_ms=round(1000 / load.rate_hz),
        surge=surge,
    )
    plan = runs.Plan(bundle=load.bundle, warmup_s=LOAD_WARMUP_S, surge=surge)
    with (
        in_one_line(),
        tempfile.TemporaryDirectory() as state,
        running_service({**settings, "state_dir": state}, config) as service,
        scraping(service.metrics_url, SCRAPE_EVERY_S),
        connect(service.endpoint) as session,
        progress_bar(f"{load.vehicles} vehicles", total_s, console) as show_progress,
    ):
        return runs.run(session, frames, Keys(PREFIX, "load"), plan, on_progress=show_progress)
