"""`headway watch`: the page for a terminal; lines of text when the output is no terminal."""

import json
import os
import sys
import threading
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.live import Live

from headway.client import BusFeed, Feed
from headway.dashboard.broadcast import wall_us
from headway.dashboard.contact import ContactNotice
from headway.dashboard.terminal.keyboard import keyboard
from headway.dashboard.terminal.tables import Choice, clock, health, number, screen
from headway.dashboard.view_state import Row, ViewState
from headway_schemas.query import AlertsQuery

REFRESH_S: Final = 0.5
_HISTORY_ATTEMPTS: Final = 20
_HEALTH_EVERY_US: Final = 10_000_000


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
        for handling in self.feed.handlings(self.sites):
            self.view_state.apply_handling(handling, self.revision)
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
    choice = Choice()
    with Live(console=console, screen=True, auto_refresh=False) as live, keyboard() as keys:
        while not (ended.is_set() or choice.is_over):
            watcher.refresh()
            state, connection = watcher.view_state, watcher.feed.connection
            live.update(screen(state, connection, watcher.revision, console.height, where, choice), refresh=True)
            choice.press(keys.pressed(REFRESH_S))


def json_lines(changes: Row) -> Iterator[str]:
    """Yield what changed as JSON objects."""
    for kind, table in (("event", "updates"), ("health", "instances"), ("rejected", "copies")):
        for row in changes[table]:
            yield json.dumps({"type": kind} | row)


def plain_lines(changes: Row) -> Iterator[str]:
    """Yield what changed as lines of text."""
    for s in changes["updates"]:
        yield (
            f"{clock(s['detected_us'])} {s['site']} {s['phase']} {s['kind']} {s['sensor']} {s['suspect']}"
            f" {_place(s)}, statistic {number(s['statistic'])} gate {number(s['gate'])}"
        )
    for h in changes["instances"]:
        yield f"{clock(h['t_us'])} {h['site']} health {h['instance']} {health(h)}"


def _place(update: Row) -> str:
    """Return where the suspect is in the pair."""
    if update["suspect"] == update["leader"]:
        return f"ahead of {update['follower']}"
    return f"behind {update['leader']}" if update["leader"] else "on a free road"
