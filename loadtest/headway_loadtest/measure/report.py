"""What a run came to, for people and for scripts."""

from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console, Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from headway_loadtest.measure.accounting import Ledger
from headway_loadtest.measure.detection import Quality
from headway_loadtest.measure.overload import Surged
from headway_loadtest.measure.percentiles import Percentiles
from headway_loadtest.measure.result import Outcome

SECONDS_FROM_S = 0.1
"""Shorter durations are shown in milliseconds."""
GENERATOR_LATE_MS = 5.0
"""A generator that is later than this one time in a hundred says so."""


MEANINGS = {
    "noise": "readings scatter",
    "bias": "readings are off by a constant",
    "drift": "readings move away slowly",
    "short": "one reading is off",
    "miss": "readings stay out",
    "feigned-brake": "pretends to brake",
    "drag": "drags its position along",
    "replay": "sends what it drove before",
    "freeze": "keeps sending one speed",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Targets:
    """What a load test must meet; None is not asked for. Nothing lost and nothing unaccounted is always asked for."""

    p50_ms: float | None = None
    p99_ms: float | None = None
    service_cpu_us: float | None = None
    service_cpu_percent: float | None = None
    """Of one core."""
    rss_mb: float | None = None
    recovered_s: float | None = None
    """After a surge; what it sheds is then no loss that counts."""
    surge_p99_ms: float | None = None
    rss_growth: float | None = None
    """Share by which memory may grow after the first minute."""


def missed_targets(outcome: Outcome, targets: Targets) -> list[str]:
    """Name each target that is missed, or cannot be known, in a sentence; none where all are met."""
    service = outcome.service
    if service is None:
        return ["no service reported on this site"]
    ledger, latency = service.ledger, outcome.latency
    p50_ms, p99_ms = (latency.p50, latency.p99) if latency else (None, None)
    surged = service.surged
    shed = () if surged is None else ("shed", "stale")
    surge_p99_ms = surged.latency.p99 if surged and surged.latency else None
    recovered_s = surged.recovered_s if surged else None
    found = [f"{n} messages lost ({reason})" for reason, n in ledger.lost.items() if reason not in shed]
    if ledger.unaccounted:
        found.append(f"{ledger.unaccounted} messages unaccounted")
    for name, actual, target in (
        ("p50 ms", p50_ms, targets.p50_ms),
        ("p99 ms", p99_ms, targets.p99_ms),
        ("service CPU us per message", service.cpu_us, targets.service_cpu_us),
        ("service CPU % of a core", _cpu_percent(outcome), targets.service_cpu_percent),
        ("service memory MB", service.rss_mb, targets.rss_mb),
        ("memory now by that after a minute", service.rss_ratio, targets.rss_growth and 1.0 + targets.rss_growth),
        ("p99 ms during the surge", surge_p99_ms, targets.surge_p99_ms),
        ("seconds from the end of the surge to normal", recovered_s, targets.recovered_s),
    ):
        if target is not None and actual is None:
            found.append(f"{name} is not known")
        elif target is not None and actual is not None and actual > target:
            found.append(f"{name} is {actual:.2f}, above {target:g}")
    return found


def _cpu_percent(outcome: Outcome) -> float | None:
    service_us = outcome.service.cpu_us if outcome.service else None
    return None if service_us is None else 1e-4 * service_us * outcome.sent / outcome.seconds


def to_json(outcome: Outcome, targets: Targets) -> dict[str, Any]:
    """Return the JSON object of a run: plain values only, None where something is not known."""
    service, ledger = outcome.service, outcome.service.ledger if outcome.service else None
    failed = missed_targets(outcome, targets)
    return {
        "vehicles": outcome.vehicles,
        "seconds": round(outcome.seconds, 3),
        "warmup_s": outcome.warmup_s,
        "speed": outcome.speed,
        "offered_hz": round(outcome.sent / outcome.seconds, 1),
        "sent": outcome.sent,
        "scored": ledger and ledger.scored,
        "warming": ledger and ledger.warming,
        "rejected": dict(ledger.rejected) if ledger else None,
        "lost": dict(ledger.lost) if ledger else None,
        "unaccounted": ledger and ledger.unaccounted,
        "latency_ms": outcome.latency and outcome.latency.to_json(),
        "alert_latency_ms": outcome.alert_latency and outcome.alert_latency.to_json(),
        "stage_ms": service and {stage: percentiles.to_json() for stage, percentiles in service.stages.items()},
        "generator_late_ms": outcome.late and outcome.late.to_json(),
        "generator_stalled_s": round(outcome.stalled_s, 3),
        "cpu_us_per_msg": {
            "service": service and _rounded(service.cpu_us),
            "generator": _rounded(outcome.generator_cpu_us),
        },
        "rss_mb": service and _rounded(service.rss_mb),
        "rss_warm_mb": service and _rounded(service.rss_warm_mb),
        "rss_minute_mb": service and _rounded(service.rss_minute_mb),
        "surge": service and service.surged and _surge_json(service.surged),
        "alerts": outcome.alerts,
        "alerts_unread": outcome.unread,
        "detection": detection_json(outcome.quality),
        "slo": {"ok": not failed, "missed": failed, "targets": asdict(targets)},
    }


def _surge_json(surged: Surged) -> dict[str, Any]:
    return {
        "vehicles": surged.vehicles,
        "seconds": surged.seconds,
        "judged_hz": round(surged.judged_hz, 1),
        "latency_ms": surged.latency and surged.latency.to_json(),
        "lost": surged.lost,
        "normal_p99_ms": _rounded(surged.normal_p99_ms),
        "recovered_s": _rounded(surged.recovered_s),
    }


def detection_json(quality: Quality) -> dict[str, Any]:
    """Return detection quality as plain values."""
    return {
        "events": quality.events,
        "found": quality.found,
        "by_kind": {kind: asdict(score) for kind, score in quality.by_kind.items()},
        "false_alarms": quality.false_alarms,
        "false_alarms_per_vehicle_hour": round(quality.false_alarms_per_vehicle_hour, 3),
        "wrong_vehicle": quality.wrong_vehicle,
        "departures": quality.departures,
        "vehicle_hours": round(quality.vehicle_hours, 4),
    }


def show(outcome: Outcome, console: Console) -> None:
    """Print the report for people."""
    console.print(Panel(Group(*_parts(outcome)), title="Result", border_style="cyan", expand=False))


def _parts(outcome: Outcome) -> list[RenderableType]:
    minutes = outcome.seconds / 60
    drove = f"[bold]{outcome.vehicles}[/] vehicles drove for {minutes:.1f} minutes"
    parts: list[RenderableType] = [
        f"{drove} and sent [bold]{outcome.sent:,}[/] messages.",
        "",
        _detection(outcome.quality),
        _false_alarms(outcome.quality),
    ]
    if outcome.service is None:
        parts += ["", Text("No headway service reported on this site, so its counts are unknown.", "bold red")]
        return parts
    parts += ["", _accounts(outcome.service.ledger), _accounts_verdict(outcome.service.ledger), "", _times(outcome)]
    parts += [line for line in _remarks(outcome) if line]
    return parts


def _detection(quality: Quality) -> RenderableType:
    if not quality.by_kind:
        return Text("No faults were injected.", "dim")
    table = Table(title="Faults injected and found", title_justify="left", box=None, pad_edge=False)
    table.add_column("what")
    for heading in ("injected", "found", "half within"):
        table.add_column(heading, justify="right")
    for kind, score in quality.by_kind.items():
        table.add_row(f"{kind}: {MEANINGS[kind]}", str(score.events), str(score.found), _duration(score.delay_s))
    if quality.found < quality.events:
        table.caption = "Sizes are drawn around zero. A fault below the scatter of its sensor stays hidden."
        table.caption_justify = "left"
    table.add_row("[bold]all[/]", f"[bold]{quality.events}[/]", f"[bold]{quality.found}[/]", "")
    return table


def _false_alarms(quality: Quality) -> RenderableType:
    lines = [f"False alarms: [bold]{quality.false_alarms}[/] in {quality.vehicle_hours:.1f} hours of driving."]
    if quality.wrong_vehicle:
        lines.append(f"Alarms with the neighbour of the faulty vehicle as suspect: {quality.wrong_vehicle}.")
    return "\n".join(lines)


def _accounts(ledger: Ledger) -> Table:
    table = Table(title="Every message accounted for", title_justify="left", box=None, pad_edge=False)
    table.add_column("outcome")
    table.add_column("messages", justify="right")
    rows = [("scored", ledger.scored), ("warming: its sender is new", ledger.warming)]
    rows += [(f"rejected: {reason.replace('_', ' ')}", n) for reason, n in ledger.rejected.items()]
    rows += [(f"lost: {reason.replace('_', ' ')}", n) for reason, n in ledger.lost.items()]
    for name, count in rows:
        table.add_row(name, f"{count:,}")
    return table


def _accounts_verdict(ledger: Ledger) -> Text:
    if ledger.unaccounted == 0:
        return Text(f"{ledger.sent:,} sent, none unaccounted for.", "green")
    if ledger.unaccounted > 0:
        return Text(f"{ledger.unaccounted:,} of {ledger.sent:,} sent are unaccounted for.", "bold red")
    return Text(f"{-ledger.unaccounted:,} more than were sent here: this service has other senders too.", "yellow")


def _times(outcome: Outcome) -> Table:
    table = Table(title="Latency (ms)", title_justify="left", box=None, pad_edge=False)
    table.add_column("since the intended send")
    for heading in ("half within", "99 % within", "99.9 % within", "longest"):
        table.add_column(heading, justify="right")
    for name, percentiles in (
        ("until the outcome", outcome.latency),
        ("until the alert arrived", outcome.alert_latency),
        ("until the actual send", outcome.late),
    ):
        if percentiles is not None:
            table.add_row(name, *_milliseconds(percentiles))
    return table


def _milliseconds(percentiles: Percentiles) -> list[str]:
    return [f"{value:.1f}" for value in (percentiles.p50, percentiles.p99, percentiles.p999, percentiles.max)]


def _remarks(outcome: Outcome) -> list[str]:
    late = outcome.late
    service_us = outcome.service.cpu_us if outcome.service else None
    return [
        f"Processor time per message: service {service_us:.1f} us." if service_us is not None else "",
        f"The first {outcome.warmup_s:g} s are warm-up and not timed." if outcome.warmup_s else "",
        _surge(outcome.service.surged) if outcome.service and outcome.service.surged else "",
        f"[yellow]The generator itself was late: 99 % within {late.p99:.1f} ms. Times include that.[/]"
        if late is not None and late.p99 > GENERATOR_LATE_MS
        else "",
        f"[yellow]Sending was held up for {outcome.stalled_s:.1f} s in all.[/]" if outcome.stalled_s else "",
    ]


def _surge(surged: Surged) -> str:
    p99 = "unknown" if surged.latency is None else f"{surged.latency.p99:.0f} ms"
    back = "never back to normal" if surged.recovered_s is None else f"normal {surged.recovered_s:.1f} s after"
    return (
        f"A surge of {surged.vehicles} more for {surged.seconds:g} s: {surged.judged_hz:,.0f} a second processed, 99 % "
        f"within {p99}, {surged.lost:,} shed, {back}. The other times are those before it."
    )


def _duration(seconds: float | None) -> str:
    if seconds is None:
        return "-"
    return f"{seconds:.1f} s" if seconds >= SECONDS_FROM_S else f"{seconds * 1e3:.0f} ms"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 2)
