"""`headway watch`: the page for a terminal; lines of text when the output is no terminal."""

import json
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Final

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.text import Text

from headway.client import BusFeed, Connection, Feed
from headway.dashboard.broadcast import wall_us
from headway.dashboard.contact import ContactNotice
from headway.dashboard.fitted_table import FittedTable
from headway.dashboard.view_state import PAIR_COLUMNS, Row, ViewState
from headway_schemas import Event
from headway_schemas.query import AlertsQuery

REFRESH_S: Final = 0.5
_ALERTS_SHOWN: Final = 12
_HISTORY_ATTEMPTS: Final = 20
_HEALTH_EVERY_US: Final = 10_000_000
_OPEN_US: Final = 60_000_000
"""An event without an update for longer is shown as over."""
_WHOLE_FROM: Final = 10_000
"""Larger numbers are shown without decimals."""
_STYLES: Final = {"anomalous": "bold red", "silent": "magenta", "warming": "bright_black", "normal": "cyan"}
_URGENCY: Final = tuple(_STYLES)


def watch(
    *,
    connect: Sequence[str] = ("tcp/127.0.0.1:7447",),
    sites: Sequence[str] = ("local",),
    prefix: str = "v2x",
    zenoh_config: Path | None = None,
    as_json: bool = False,
    stop: threading.Event | None = None,
) -> None:
    """Show what the service publishes until SIGINT, or until `stop` is set.

    On a terminal this is a live view. Elsewhere it prints a line for each event update and health report from now on.
    With `as_json` each line is a JSON object with a `type`: `event`, `health` or `rejected`.

    Raises
    ------
    UserError
        An option is invalid.
    """
    feed = BusFeed(connect, sites, prefix=prefix, zenoh_config=zenoh_config)
    console = Console()
    live = console.is_terminal and not as_json
    watcher = Watcher(feed, sites, since_us=0 if live else wall_us())
    ended = stop or threading.Event()
    feed.start()
    try:
        if live:
            _show(watcher, console, ended, ", ".join(connect))
        else:
            _print_lines(watcher, ended, ContactNotice("watch", connect), as_json=as_json)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:
        # The reader of the lines has closed; discard what Python still buffers for standard output.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        feed.close()


@dataclass(slots=True)
class Watcher:
    """A view state that is refreshed from a feed, in one thread."""

    feed: Feed
    sites: Sequence[str]
    since_us: int
    """The history before this time is not fetched."""
    view_state: ViewState = field(default_factory=ViewState)
    revision: int = 0
    _caught_up: int = 0
    _attempts: int = 0

    def refresh(self) -> Row:
        """Apply the new messages and return what changed."""
        before, self.revision = self.revision, max(wall_us(), self.revision + 1)
        for received in self.feed.drain():
            self.view_state.apply(received, self.revision)
        self._fill_gaps()
        self._catch_up()
        self.view_state.evict(self.revision)
        return self.view_state.delta(before)

    def _catch_up(self) -> None:
        """Fetch the events since the last connection; a journal may take a moment to be found."""
        connection = self.feed.connection
        if not connection.connected or connection.connections == self._caught_up:
            return
        history = self.feed.history(self.sites, AlertsQuery(from_us=self.since_us or None, limit=200))
        for event in reversed(history.events):
            self.view_state.apply_event(event, self.revision)
        self._attempts += 1
        if history.answers or self._attempts >= _HISTORY_ATTEMPTS:
            self._caught_up, self._attempts = connection.connections, 0

    def _fill_gaps(self) -> None:
        """Fetch the updates that were published and not received; what no journal answers is asked for again."""
        gaps, self.view_state.missing = self.view_state.missing, []
        for site, query in gaps:
            history = self.feed.history([site], query)
            for event in reversed(history.events):
                self.view_state.apply_event(event, self.revision)
            if not history.answers:
                self.view_state.missing.append((site, query))


def _print_lines(watcher: Watcher, ended: threading.Event, notice: ContactNotice, *, as_json: bool) -> None:
    health_printed_us = 0
    while not ended.is_set():
        changes = watcher.refresh()
        notice.update(connected=watcher.feed.connection.connected)
        if as_json:
            lines = json_lines(changes)
        else:
            if watcher.revision - health_printed_us < _HEALTH_EVERY_US:
                changes["instances"] = []
            elif changes["instances"]:
                health_printed_us = watcher.revision
            lines = plain_lines(changes)
        for line in lines:
            sys.stdout.write(line + "\n")
        sys.stdout.flush()
        ended.wait(REFRESH_S)


def _show(watcher: Watcher, console: Console, ended: threading.Event, where: str) -> None:
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while not ended.is_set():
            watcher.refresh()
            view = screen(watcher.view_state, watcher.feed.connection, watcher.revision, console.height, where)
            live.update(view, refresh=True)
            ended.wait(REFRESH_S)


def json_lines(changes: Row) -> Iterator[str]:
    """Yield what changed as JSON objects."""
    for kind, table in (("event", "updates"), ("health", "instances"), ("rejected", "copies")):
        for row in changes[table]:
            yield json.dumps({"type": kind} | row)


def plain_lines(changes: Row) -> Iterator[str]:
    """Yield what changed as lines of text."""
    for s in changes["updates"]:
        yield (
            f"{_clock(s['detected_us'])} {s['site']} {s['phase']} {s['kind']} {s['sensor']} {s['suspect']}"
            f" {_place(s)}, statistic {_number(s['statistic'])} gate {_number(s['gate'])}"
        )
    for h in changes["instances"]:
        yield f"{_clock(h['t_us'])} {h['site']} health {h['instance']} {_health(h)}"


def screen(view_state: ViewState, connection: Connection, now_us: int, height: int, where: str = "") -> RenderableType:
    """Return the live view for a terminal of `height` lines; `where` names the endpoints of the bus."""
    instances = _instances(view_state)
    alerts = _alerts(view_state, now_us)
    room = height - len(view_state.instances) - min(len(alerts.rows), _ALERTS_SHOWN) - 9
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
    return Text.assemble(("headway ", "bold"), contact, (trouble, "yellow"))


def _instances(view_state: ViewState) -> FittedTable:
    table = FittedTable(
        ("site", "instance", "", "vehicles", "scored/s", "p50 ms", "p99 ms", "queue", "rejected", "lost"),
        droppable=("p50 ms", "queue", "site", "scored/s", "lost", "vehicles"),
        wrapping=("rejected", "lost"),
    )
    for h in view_state.instances:
        ready = Text("ready", "green") if h["ready"] else Text("not ready", "red")
        rates, latency = h["rates_hz"], h["latency_ms"]
        table.add_row(
            h["site"], h["instance"], ready, str(h["vehicles"]), _number(rates.get("scored")),
            _number(latency.get("p50")), _number(latency.get("p99")), str(h["queue_depth"]),
            _reasons(h["rejected"]), _reasons(h["lost"]),
        )  # fmt: skip
    return table


def _alerts(view_state: ViewState, now_us: int) -> FittedTable:
    table = FittedTable(
        ("alert", "site", "kind", "sensor", "suspect", "behind", "statistic", "gate", ""),
        droppable=("gate", "statistic", "site", "behind", "sensor"),
    )
    newest = {event.event_id: event for event in sorted(view_state.updates, key=lambda event: event.detected_us)}
    for event in sorted(newest.values(), key=lambda event: event.detected_us, reverse=True)[:_ALERTS_SHOWN]:
        open_now = event.phase != "cleared" and now_us - event.detected_us < _OPEN_US
        table.add_row(
            _clock(event.detected_us), event.site, event.kind, event.sensor, event.suspect, _leader(event),
            _number(event.statistic), _number(event.gate), event.phase, style=_STYLES["anomalous"] if open_now else "",
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
            _number(r["gap_m"]), _number(r["v_mps"]), _number(r["statistic"]), _number(r["gate"]),
        )  # fmt: skip
    if len(rows) > room:
        table.caption = f"and {len(rows) - room} more"
    return table


def _health(row: Row) -> str:
    latency, rates = row["latency_ms"], row["rates_hz"]
    state = "ready" if row["ready"] else "not ready"
    return (
        f"{state}, {row['vehicles']} vehicles, {_number(rates.get('scored'))} scored/s,"
        f" p50 {_number(latency.get('p50'))} p99 {_number(latency.get('p99'))} ms, queue {row['queue_depth']},"
        f" rejected {_reasons(row['rejected'])}, lost {_reasons(row['lost'])}"
    )


def _reasons(counts: dict[str, int]) -> str:
    worst = sorted(counts.items(), key=lambda item: -item[1])
    return " ".join(f"{reason} {n}" for reason, n in worst if n) or "none"


def _place(update: Row) -> str:
    """Return where the suspect is in the pair."""
    if update["suspect"] == update["leader"]:
        return f"ahead of {update['follower']}"
    return f"behind {update['leader']}" if update["leader"] else "on a free road"


def _leader(event: Event) -> str:
    """Return the vehicle ahead of the suspect, which may be the leader of the pair itself."""
    return "-" if event.leader is None or event.leader == event.suspect else event.leader


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}" if abs(value) < _WHOLE_FROM else f"{value:.0f}"


def _clock(us: int) -> str:
    return datetime.fromtimestamp(us / 1e6, UTC).astimezone().strftime("%H:%M:%S")
