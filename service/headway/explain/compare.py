"""`headway explain`: the stored values of an event beside those that the same kernels compute from its readings now."""

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, Final

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

_ESTIMATED: Final = ("x_m", "v_mps", "x_std_m", "v_std_mps", "statistic", "gate")


@dataclass(frozen=True, slots=True)
class Number:
    """One value of an event update: as stored, and as computed now."""

    name: str
    stored: Value
    recomputed: Value

    @property
    def same(self) -> bool:
        """Whether both are equal to the last bit."""
        return _bits(self.stored) == _bits(self.recomputed)


@dataclass(frozen=True, slots=True)
class Explained:
    """One event update, replayed."""

    event: Event
    numbers: list[Number] = field(default_factory=list)
    readings: Records | None = None
    verdicts: Records | None = None
    """(n,) verdict on each of the readings (n,)."""
    problem: str | None = None
    """Why it was not replayed; None: it was."""

    @property
    def same(self) -> bool:
        """Whether it was replayed and no value differs."""
        return self.problem is None and all(number.same for number in self.numbers)


def same(explained: Sequence[Explained]) -> bool:
    """Whether every update with evidence was replayed to the last bit."""
    return all(one.same or one.event.evidence is None for one in explained)


def replayed(event: Event) -> Explained:
    """Compute the verdict of an update again from its evidence."""
    if event.evidence is None:
        missed = event.kind is wire.Kind.MISS
        return Explained(event, problem="a miss has no readings" if missed else "it carries no evidence")
    try:
        evidence, config = from_wire(event.evidence)
    except (ValueError, KeyError) as error:
        return Explained(event, problem=f"made by another version: {error}")
    again = replay(evidence, config)
    verdicts = again.by_pair_tests if event.sensor is wire.Sensor.LINK else again.by_filter
    return Explained(event, _compared(event, verdicts[-1]), evidence.readings, verdicts)


def to_json(explained: Sequence[Explained]) -> dict[str, Any]:
    """Return all of it as one object."""
    return {
        "event_id": explained[0].event.event_id,
        "same": same(explained),
        "here": {"version": version(), "core": core_digest()},
        "updates": [
            {
                "phase": one.event.phase,
                "detected_us": one.event.detected_us,
                "made_by": _maker(one.event),
                "problem": one.problem,
                "same": one.same,
                "numbers": {n.name: {"stored": n.stored, "recomputed": n.recomputed} for n in one.numbers},
            }
            for one in explained
        ],
    }


def estimates(explained: Sequence[Explained]) -> list[dict[str, float | None]]:
    """Return the estimate with each reading of the evidence, oldest first: m and m/s, with one sigma of each."""
    rows: dict[float, dict[str, float | None]] = {
        float(reading["t_s"]): {name: _finite(verdict[name]) for name in _ESTIMATED}
        for one in explained
        if one.readings is not None and one.verdicts is not None
        for reading, verdict in zip(one.readings, one.verdicts, strict=True)
    }
    return [rows[t_s] | {"t_s": t_s} for t_s in sorted(rows)]


def _compared(event: Event, verdict: np.void) -> list[Number]:
    """Compare the values of an update with the verdict on its last reading.

    Some values do not follow from a single row and are left out: suspect and confidence of a test between two cars, the
    kind that an onset leaves open, what becomes of a single odd reading in an event that began before, and the
    confidence of an earlier reading.
    """
    numbers = [
        Number(name, getattr(event, name), _finite(verdict[name])) for name in ("statistic", "gate", "p_value", "nis")
    ]
    if event.innovation is not None:
        stored = event.innovation
        numbers.append(Number("innovation.x_m", stored.x_m, _finite(verdict["nu"][0])))
        numbers.append(Number("innovation.v_mps", stored.v_mps, _finite(verdict["nu"][1])))
    if event.recovered is not None:
        recovered = event.recovered.model_dump()
        numbers += [Number(f"recovered.{name}", value, _finite(verdict[name])) for name, value in recovered.items()]
    if event.phase is not Phase.UPDATE:
        numbers.append(Number("anomalous", event.phase is Phase.ONSET, bool(verdict["anomalous"])))
    if event.phase is not Phase.CLEARED and verdict["anomalous"]:
        kind = Kind(int(verdict["kind"]))
        if kind is not Kind.SHORT and event.kind is not wire.Kind.UNKNOWN:
            numbers.append(Number("kind", event.kind.value, kind.label))
        numbers.append(Number("sensor", event.sensor.value, Sensor(int(verdict["sensor"])).label))
    found = verdict["anomalous"] and Kind(int(verdict["kind"])).label == event.kind.value
    if event.sensor is not wire.Sensor.LINK and (found or event.phase is Phase.ONSET):
        numbers.append(Number("confidence", event.confidence, _finite(verdict["confidence"])))
    return numbers


def _finite(value: float) -> float | None:
    """Return a number as the wire has it: None where it is not finite."""
    return float(value) if np.isfinite(value) else None


def _bits(value: Value) -> Value | bytes:
    return struct.pack("d", value) if isinstance(value, float) else value


def _maker(event: Event) -> dict[str, Any]:
    parameters = event.evidence.parameters if event.evidence is not None else {}
    return {"version": parameters.get("version"), "core": parameters.get("core"), "config_hash": event.config_hash}


def show(explained: Sequence[Explained], console: Console) -> None:
    """Print the stored values beside those computed now."""
    first = explained[0]
    event, maker = first.event, _maker(first.event)
    console.print(
        f"[bold]{event.event_id}[/]  {event.kind} of {event.sensor}, suspect {event.suspect}, "
        f"{event.follower} behind {event.leader or 'no vehicle'}, site {event.site}"
    )
    if event.evidence is not None:
        console.print(f"detected by headway {maker['version']}, core {maker['core']}, config {maker['config_hash']}")
        console.print(f"replayed by headway {version()}, core {core_digest()}")
    for one in explained:
        _show_update(one, console, whole=one is first or not one.same)


def _show_update(one: Explained, console: Console, *, whole: bool) -> None:
    head = f"{one.event.phase} at {one.event.t_us} us"
    if one.problem is not None or one.readings is None:
        console.print(f"{head}: not replayed, {one.problem}")
        return
    differing = [number.name for number in one.numbers if not number.same]
    verdict = f"[red]{', '.join(differing)} differ[/]" if differing else "[green]equal to the last bit[/]"
    console.print(f"{head}: {one.readings.size} readings, {len(one.numbers)} values, {verdict}")
    if differing and _maker(one.event)["core"] != core_digest():
        console.print("Another version of the core made it; only that version computes the same bits.")
    if not whole:
        return
    table = Table("", "stored", "computed now", "")
    for number in one.numbers:
        table.add_row(number.name, _text(number.stored), _text(number.recomputed), "=" if number.same else "[red]≠[/]")
    console.print(table)


def _text(value: Value) -> str:
    return "unknown" if value is None else repr(value) if isinstance(value, float) else str(value)
