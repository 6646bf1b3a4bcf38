"""`headway explain`: what was said of an event, beside what the same kernels say of the same readings now."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from headway.core.replay import replay
from headway.core.types.records import Kind, Records, Sensor
from headway.edge.codec.evidence import from_wire
from headway.kernel_cache import core_digest
from headway.version import version
from headway_schemas import event as wire
from headway_schemas.event import Event, Phase

Value = float | str | bool | None


@dataclass(frozen=True, slots=True)
class Number:
    """One thing that was said, and what comes out now."""

    name: str
    stored: Value
    recomputed: Value

    @property
    def same(self) -> bool:
        """Whether both are the same to the last bit."""
        return _bits(self.stored) == _bits(self.recomputed)


@dataclass(frozen=True, slots=True)
class Explained:
    """One statement of an event, replayed."""

    event: Event
    numbers: list[Number] = field(default_factory=list)
    readings: Records | None = None
    verdicts: Records | None = None
    """(n,) what was said of each of the readings (n,)."""
    hindrance: str | None = None
    """Why it was not replayed."""

    @property
    def same(self) -> bool:
        """Whether it was replayed and nothing differs."""
        return self.hindrance is None and all(number.same for number in self.numbers)


def same(explained: Sequence[Explained]) -> bool:
    """Whether everything that carries evidence was replayed to the last bit."""
    return all(one.same or one.event.evidence is None for one in explained)


def replayed(event: Event) -> Explained:
    """Judge the readings of a statement again."""
    if event.evidence is None:
        missed = event.kind is wire.Kind.MISS
        return Explained(event, hindrance="silence leaves no readings" if missed else "it carries no evidence")
    try:
        evidence, config = from_wire(event.evidence)
    except (ValueError, KeyError) as error:
        return Explained(event, hindrance=f"another version made it: {error}")
    again = replay(evidence, config)
    verdicts = again.by_pair_tests if event.sensor is wire.Sensor.LINK else again.by_filter
    return Explained(event, _compared(event, verdicts[-1]), evidence.readings, verdicts)


def to_json(explained: Sequence[Explained]) -> dict[str, Any]:
    """Return all of it as one object."""
    return {
        "event_id": explained[0].event.event_id,
        "same": same(explained),
        "here": {"version": version(), "core": core_digest()},
        "statements": [
            {
                "phase": one.event.phase,
                "detected_us": one.event.detected_us,
                "made_by": _maker(one.event),
                "hindrance": one.hindrance,
                "same": one.same,
                "numbers": {n.name: {"stored": n.stored, "recomputed": n.recomputed} for n in one.numbers},
            }
            for one in explained
        ],
    }


def _compared(event: Event, verdict: Any) -> list[Number]:
    """Set what the statement says beside the verdict of its last reading.

    Left out is what no single row can tell: of a test between two cars who is to blame and how surely, and when an
    event ends its kind, which is the one of its last alarm.
    """
    numbers = [
        Number(name, getattr(event, name), _finite(verdict[name])) for name in ("statistic", "gate", "p_value", "nis")
    ]
    if event.innovation is not None:
        stored = event.innovation
        numbers.append(Number("innovation.x_m", stored.x_m, _finite(verdict["nu"][0])))
        numbers.append(Number("innovation.v_mps", stored.v_mps, _finite(verdict["nu"][1])))
    if event.recovered is not None:
        stands = event.recovered.model_dump()
        numbers += [Number(f"recovered.{name}", value, _finite(verdict[name])) for name, value in stands.items()]
    numbers.append(Number("anomalous", event.phase is not Phase.CLEARED, bool(verdict["anomalous"])))
    if event.phase is not Phase.CLEARED:
        numbers.append(Number("kind", event.kind.value, Kind(int(verdict["kind"])).label))
        numbers.append(Number("sensor", event.sensor.value, Sensor(int(verdict["sensor"])).label))
    if event.sensor is not wire.Sensor.LINK:
        numbers.append(Number("confidence", event.confidence, _finite(verdict["confidence"])))
    return numbers


def _finite(value: Any) -> float | None:
    """Return a number as the wire has it."""
    return float(value) if np.isfinite(value) else None


def _bits(value: Value) -> Value | bytes:
    return struct.pack("d", value) if isinstance(value, float) else value


def _maker(event: Event) -> dict[str, Any]:
    parameters = event.evidence.parameters if event.evidence is not None else {}
    return {"version": parameters.get("version"), "core": parameters.get("core"), "config_hash": event.config_hash}


def show(explained: Sequence[Explained], console: Console) -> None:
    """Print what was said beside what comes out now."""
    first = explained[0]
    event, maker = first.event, _maker(first.event)
    console.print(
        f"[bold]{event.event_id}[/]  {event.kind} of {event.sensor}, suspect {event.suspect}, "
        f"{event.follower} following {event.leader or 'nobody'}, site {event.site}"
    )
    if event.evidence is not None:
        console.print(f"judged by headway {maker['version']}, core {maker['core']}, config {maker['config_hash']}")
        console.print(f"replayed by headway {version()}, core {core_digest()}")
    for one in explained:
        _show_statement(one, console, whole=one is first or not one.same)


def _show_statement(one: Explained, console: Console, *, whole: bool) -> None:
    head = f"{one.event.phase} at {one.event.t_us} us"
    if one.hindrance is not None or one.readings is None:
        console.print(f"{head}: not replayed, {one.hindrance}")
        return
    differing = [number.name for number in one.numbers if not number.same]
    verdict = f"[red]{', '.join(differing)} differ[/]" if differing else "[green]the same to the last bit[/]"
    console.print(f"{head}: {one.readings.size} readings, {len(one.numbers)} values, {verdict}")
    if differing and _maker(one.event)["core"] != core_digest():
        console.print("Another version of the core made it; only that one says the same to the last bit.")
    if not whole:
        return
    table = Table("", "said then", "comes out now", "")
    for number in one.numbers:
        table.add_row(number.name, _text(number.stored), _text(number.recomputed), "=" if number.same else "[red]≠[/]")
    console.print(table)


def _text(value: Value) -> str:
    return "unknown" if value is None else repr(value) if isinstance(value, float) else str(value)
