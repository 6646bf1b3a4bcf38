"""The live view of `headway watch`: tables that fit a terminal."""

from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final

from rich.console import Group, RenderableType
from rich.text import Text

from headway.client import Connection
from headway.dashboard.terminal.fitted_table import FittedTable
from headway.dashboard.vehicles import ORDERS, VehicleEvents, vehicles_of
from headway.dashboard.view_state import PAIR_COLUMNS, Row, ViewState, silence_us
from headway_schemas import Event

ALERTS_SHOWN: Final = 12
_OPEN_US: Final = 60_000_000
"""An event without an update for longer is shown as over."""
_WHOLE_FROM: Final = 10_000
"""Larger numbers are shown without decimals."""
_STYLES: Final = {"anomalous": "bold red", "silent": "magenta", "warming": "bright_black", "normal": "cyan"}
_URGENCY: Final = tuple(_STYLES)
_STATE_STYLES: Final = {"open": "bold red", "silent": "magenta", "over": "", "not known": ""}
_KEYS: Final = "s sorts, v vehicles or alerts, j k scroll, q quits"


@dataclass(slots=True)
class Choice:
    """What the person at the terminal chose."""

    order: str = "worst"
    by_vehicle: bool = True
    skipped: int = 0
    """Rows scrolled away."""
    is_over: bool = False

    def press(self, key: str) -> None:
        """Follow a key."""
        match key:
            case "s":
                names = list(ORDERS)
                self.order, self.skipped = names[(names.index(self.order) + 1) % len(names)], 0
            case "v":
                self.by_vehicle, self.skipped = not self.by_vehicle, 0
            case "j":
                self.skipped += 1
            case "k":
                self.skipped = max(0, self.skipped - 1)
            case "q":
                self.is_over = True


def screen(
    view_state: ViewState,
    connection: Connection,
    now_us: int,
    height: int,
    where: str = "",
    choice: Choice | None = None,
) -> RenderableType:
    """Return the live view for a terminal of `height` lines; `where` names the endpoints of the bus."""
    choice = choice or Choice()
    instances = _instances(view_state, now_us)
    alerts = _vehicles(view_state, now_us, choice) if choice.by_vehicle else _alerts(view_state, now_us, choice)
    room = height - len(view_state.instances) - len(alerts.rows) - 10
    return Group(_line(connection, where), instances, alerts, _pairs(view_state, max(room, 3)))


def _line(connection: Connection, where: str) -> Text:
    contact = Text(" connected ", "black on green")
    if not connection.connected:
        contact = Text.assemble((" no contact with the bus ", "white on red"), f" {where}: is `headway serve` running?")
    trouble = (
        f"  {connection.dropped} not shown, {connection.unreadable} unreadable"
        if connection.dropped or connection.unreadable
        else ""
    )
    return Text.assemble(("headway ", "bold"), contact, (trouble, "yellow"), (f"  {_KEYS}", "bright_black"))


def _instances(view_state: ViewState, now_us: int) -> FittedTable:
    table = FittedTable(
        ("site", "instance", "", "vehicles", "scored/s", "p50 ms", "p99 ms", "queue", "rejected", "lost"),
        droppable=("p50 ms", "queue", "site", "scored/s", "lost", "vehicles"),
        wrapping=("rejected", "lost"),
    )
    for h in view_state.instances:
        ready = Text("ready", "green") if h["ready"] else Text("not ready", "red")
        if silent_us := silence_us(h, now_us):
            ready = Text(f"silent for {silent_us // 1_000_000} s", "white on red")
        rates, latency = h["rates_hz"], h["latency_ms"]
        table.add_row(
            h["site"], h["instance"], ready, str(h["vehicles"]), number(rates.get("scored")),
            number(latency.get("p50")), number(latency.get("p99")), str(h["queue_depth"]),
            reasons(h["rejected"]), reasons(h["lost"]),
        )  # fmt: skip
    return table


def _vehicles(view_state: ViewState, now_us: int, choice: Choice) -> FittedTable:
    """Return a row for each vehicle with events, as the page has them."""
    table = FittedTable(
        ("vehicle", "site", "is", "kinds", "events", "first", "last", "worst m", "worst m/s", "handled"),
        droppable=("first", "handled", "worst m/s", "site", "events", "last"),
    )
    found = vehicles_of(view_state, now_us, choice.order)
    first = min(choice.skipped, max(0, len(found) - 1))
    silent_sites = {h["site"] for h in view_state.instances}
    silent_sites -= {h["site"] for h in view_state.instances if not silence_us(h, now_us)}
    for vehicle in found[first : first + ALERTS_SHOWN]:
        x_m, v_mps = vehicle.deviation
        state = "not known" if vehicle.state != "over" and vehicle.site in silent_sites else vehicle.state
        table.add_row(
            vehicle.vehicle, vehicle.site, state, _kinds(vehicle), str(vehicle.count), clock(vehicle.first_us),
            clock(vehicle.last_us), number(x_m or None), number(v_mps or None), _handled(vehicle),
            style=_STATE_STYLES[state],
        )  # fmt: skip
    rest = len(found) - first - ALERTS_SHOWN
    table.caption = f"sorted by {choice.order}" + (f", and {rest} more" if rest > 0 else "")
    return table


def _kinds(vehicle: VehicleEvents) -> str:
    return " ".join(sorted({event.newest.kind for event in vehicle.events}))


def _handled(vehicle: VehicleEvents) -> str:
    return "" if vehicle.decision is None else f"{vehicle.decision.action} by {vehicle.decision.by}"


def _alerts(view_state: ViewState, now_us: int, choice: Choice) -> FittedTable:
    table = FittedTable(
        ("alert", "site", "kind", "sensor", "suspect", "behind", "statistic", "gate", ""),
        droppable=("gate", "statistic", "site", "behind", "sensor"),
    )
    newest = sorted((known.newest for known in view_state.events), key=lambda event: -event.detected_us)
    first = min(choice.skipped, max(0, len(newest) - 1))
    for event in newest[first : first + ALERTS_SHOWN]:
        open_now = event.phase != "cleared" and now_us - event.detected_us < _OPEN_US
        table.add_row(
            clock(event.detected_us), event.site, event.kind, event.sensor, event.suspect, _leader(event),
            number(event.statistic), number(event.gate), event.phase, style=_STYLES["anomalous"] if open_now else "",
        )  # fmt: skip
    return table


def _pairs(view_state: ViewState, room: int) -> FittedTable:
    rows = [dict(zip(PAIR_COLUMNS, row, strict=True)) for row in view_state.pairs]
    rows.sort(key=lambda r: (_URGENCY.index(r["standing"]), -(r["statistic"] or 0.0), r["follower"]))
    table = FittedTable(
        ("vehicle", "site", "state", "behind", "gap m", "speed m/s", "statistic", "gate"),
        droppable=("gate", "statistic", "site", "speed m/s", "behind"),
    )
    for r in rows[:room]:
        table.add_row(
            r["follower"], r["site"], Text(r["standing"], _STYLES[r["standing"]]), r["leader"] or "-",
            number(r["gap_m"]), number(r["v_mps"]), number(r["statistic"]), number(r["gate"]),
        )  # fmt: skip
    if len(rows) > room:
        table.caption = f"and {len(rows) - room} more"
    return table


def health(row: Row) -> str:
    """Return a health report in a line."""
    latency, rates = row["latency_ms"], row["rates_hz"]
    state = "ready" if row["ready"] else "not ready"
    return (
        f"{state}, {row['vehicles']} vehicles, {number(rates.get('scored'))} scored/s,"
        f" p50 {number(latency.get('p50'))} p99 {number(latency.get('p99'))} ms, queue {row['queue_depth']},"
        f" rejected {reasons(row['rejected'])}, lost {reasons(row['lost'])}"
    )


def reasons(counts: dict[str, int]) -> str:
    """Return the reasons with their counts, most first."""
    worst = sorted(counts.items(), key=lambda item: -item[1])
    return " ".join(f"{reason} {n}" for reason, n in worst if n) or "none"


def _leader(event: Event) -> str:
    """Return the vehicle ahead of the suspect, which may be the leader of the pair itself."""
    return "-" if event.leader is None or event.leader == event.suspect else event.leader


def number(value: float | None) -> str:
    """Return a number in four digits, and a dash for none."""
    return "-" if value is None else f"{value:.4g}" if abs(value) < _WHOLE_FROM else f"{value:.0f}"


def clock(us: int) -> str:
    """Return the local time of day."""
    return datetime.fromtimestamp(us / 1e6, UTC).astimezone().strftime("%H:%M:%S")
