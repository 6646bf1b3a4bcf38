"""`headway watch`: the same as the page, for a shell; lines where nobody looks at a screen."""

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
from rich.table import Table
from rich.text import Text

from headway.client import BusFeed, Feed, Link
from headway.dashboard.broadcast import wall_us
from headway.dashboard.view_state import PAIR_COLUMNS, Board, Row
from headway_schemas.query import AlertsQuery

TURN_S: Final = 0.5
_ALERTS_SHOWN: Final = 12
_HISTORY_TRIES: Final = 20
_HEALTH_EVERY_US: Final = 10_000_000
_LOOK: Final = {"anomalous": "bold red", "silent": "magenta", "warming": "bright_black", "normal": "cyan"}
_URGENCY: Final = tuple(_LOOK)


def watch(
    *,
    connect: Sequence[str] = ("tcp/127.0.0.1:7447",),
    sites: Sequence[str] = ("local",),
    prefix: str = "v2x",
    zenoh_config: Path | None = None,
    as_json: bool = False,
    stop: threading.Event | None = None,
) -> None:
    """Show what the service tells until SIGINT, or until `stop` is set.

    On a terminal this is a live view. Elsewhere it is a line for each alert and each report of health, from now on;
    with `as_json` the lines are JSON objects that say their `type`: `statement`, `health` or `rejected`.

    Raises
    ------
    UserError
        An option is unfit.
    """
    feed = BusFeed(connect, sites, prefix=prefix, zenoh_config=zenoh_config)
    console = Console()
    live = console.is_terminal and not as_json
    watcher = Watcher(feed, sites, since_us=0 if live else wall_us())
    ended = stop or threading.Event()
    feed.start()
    try:
        if live:
            _show(watcher, console, ended)
        else:
            _tell(watcher, as_json, ended)
    except KeyboardInterrupt:
        pass
    except BrokenPipeError:
        # Whoever read the lines has enough; what Python still holds for standard output has nowhere to go.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    finally:
        feed.close()


@dataclass(slots=True)
class Watcher:
    """A board kept up from a feed, in one thread."""

    feed: Feed
    sites: Sequence[str]
    since_us: int
    """History before this instant is not asked for."""
    board: Board = field(default_factory=Board)
    revision: int = 0
    _caught_up: int = 0
    _tries: int = 0

    def turn(self) -> Row:
        """Take what came and return what is new."""
        before, self.revision = self.revision, max(wall_us(), self.revision + 1)
        for heard in self.feed.drain():
            self.board.take(heard, self.revision)
        self._catch_up()
        self.board.forget(self.revision)
        return self.board.delta(before)

    def _catch_up(self) -> None:
        """Ask for what happened while the link was down; a journal may take a moment to be found."""
        link = self.feed.link
        if not link.connected or link.connections == self._caught_up:
            return
        history = self.feed.history(self.sites, AlertsQuery(from_us=self.since_us or None, limit=200))
        for event in reversed(history.events):
            self.board.take_event(event, self.revision)
        self._tries += 1
        if history.answers or self._tries >= _HISTORY_TRIES:
            self._caught_up, self._tries = link.connections, 0


def _tell(watcher: Watcher, as_json: bool, ended: threading.Event) -> None:
    health_told_us = 0
    while not ended.is_set():
        news = watcher.turn()
        if as_json:
            lines = json_lines(news)
        else:
            if watcher.revision - health_told_us < _HEALTH_EVERY_US:
                news["instances"] = []
            elif news["instances"]:
                health_told_us = watcher.revision
            lines = plain_lines(news)
        for line in lines:
            sys.stdout.write(line + "\n")
        sys.stdout.flush()
        ended.wait(TURN_S)


def _show(watcher: Watcher, console: Console, ended: threading.Event) -> None:
    with Live(console=console, screen=True, auto_refresh=False) as live:
        while not ended.is_set():
            watcher.turn()
            live.update(screen(watcher.board, watcher.feed.link, watcher.revision, console.height), refresh=True)
            ended.wait(TURN_S)


def json_lines(news: Row) -> Iterator[str]:
    """Return what is new as JSON objects."""
    for kind, table in (("statement", "statements"), ("health", "instances"), ("rejected", "copies")):
        for row in news[table]:
            yield json.dumps({"type": kind} | row)


def plain_lines(news: Row) -> Iterator[str]:
    """Return what is new as lines of words."""
    for s in news["statements"]:
        yield (
            f"{_clock(s['detected_us'])} {s['site']} {s['phase']} {s['kind']} {s['sensor']} {s['suspect']}"
            f" {_behind(s['leader'])}, statistic {_number(s['statistic'])} gate {_number(s['gate'])}"
        )
    for h in news["instances"]:
        yield f"{_clock(h['t_us'])} {h['site']} health {h['instance']} {_health(h)}"


def screen(board: Board, link: Link, now_us: int, height: int) -> RenderableType:
    """Return the live view for a terminal of so many lines."""
    instances = _instances(board)
    alerts = _alerts(board, now_us)
    room = height - len(board.instances) - min(len(alerts.rows), _ALERTS_SHOWN) - 9
    return Group(_line(link), instances, alerts, _pairs(board, max(room, 3)))


def _line(link: Link) -> Text:
    up = Text(" connected ", "black on green") if link.connected else Text(" no contact with the bus ", "white on red")
    trouble = f"  {link.dropped} not shown, {link.unreadable} unreadable" if link.dropped or link.unreadable else ""
    return Text.assemble(("headway ", "bold"), up, (trouble, "yellow"))


def _instances(board: Board) -> Table:
    table = _table("site", "instance", "", "vehicles", "scored/s", "p50 ms", "p99 ms", "queue", "rejected", "lost")
    for h in board.instances:
        ready = Text("ready", "green") if h["ready"] else Text("not ready", "red")
        rates, latency = h["rates_hz"], h["latency_ms"]
        table.add_row(
            h["site"], h["instance"], ready, str(h["vehicles"]), _number(rates.get("scored")),
            _number(latency.get("p50")), _number(latency.get("p99")), str(h["queue_depth"]),
            _reasons(h["rejected"]), _reasons(h["lost"]),
        )  # fmt: skip
    return table


def _alerts(board: Board, now_us: int) -> Table:
    table = _table("alert", "site", "kind", "sensor", "suspect", "behind", "statistic", "gate", "")
    newest = {event.event_id: event for event in sorted(board.statements, key=lambda event: event.detected_us)}
    for event in sorted(newest.values(), key=lambda event: event.detected_us, reverse=True)[:_ALERTS_SHOWN]:
        open_now = event.phase != "cleared" and now_us - event.detected_us < 60_000_000
        table.add_row(
            _clock(event.detected_us), event.site, event.kind, event.sensor, event.suspect, event.leader or "-",
            _number(event.statistic), _number(event.gate), event.phase, style=_LOOK["anomalous"] if open_now else "",
        )  # fmt: skip
    return table


def _pairs(board: Board, room: int) -> Table:
    rows = [dict(zip(PAIR_COLUMNS, row, strict=True)) for row in board.pairs]
    rows.sort(key=lambda r: (_URGENCY.index(r["standing"]), -(r["statistic"] or 0.0), r["follower"]))
    table = _table("vehicle", "site", "state", "behind", "gap m", "speed m/s", "statistic", "gate")
    for r in rows[:room]:
        table.add_row(
            r["follower"], r["site"], Text(r["standing"], _LOOK[r["standing"]]), r["leader"] or "-",
            _number(r["gap_m"]), _number(r["v_mps"]), _number(r["statistic"]), _number(r["gate"]),
        )  # fmt: skip
    if len(rows) > room:
        table.caption = f"and {len(rows) - room} more"
    return table


def _table(*columns: str) -> Table:
    table = Table(*columns, box=None, expand=True, pad_edge=False, header_style="bright_black")
    for column in table.columns:
        column.no_wrap = True
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


def _behind(leader: str | None) -> str:
    return f"behind {leader}" if leader else "on a free road"


def _number(value: float | None) -> str:
    return "-" if value is None else f"{value:.4g}" if abs(value) < 10_000 else f"{value:.0f}"


def _clock(us: int) -> str:
    return datetime.fromtimestamp(us / 1e6, UTC).astimezone().strftime("%H:%M:%S")
