"""From the feed to any number of browsers: a turn takes what came, and each browser is told what it has not seen."""

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Final

from headway.client import Feed, History
from headway.dashboard.view_state import Board
from headway_schemas import Event, Phase
from headway_schemas.query import LIMIT_MAX, AlertsQuery

TURN_S: Final = 0.2
_CATCH_UP: Final = AlertsQuery(limit=500)
_RETRY_S: Final = (1.0, 2.0, 5.0, 10.0, 30.0)


def wall_us() -> int:
    """Return the wall clock, microseconds since 1970 UTC."""
    return time.time_ns() // 1000


class Hub:
    """Owns the feed and the board."""

    def __init__(self, feed: Feed, sites: Sequence[str], now_us: Callable[[], int] = wall_us) -> None:
        self.sites = tuple(sites)
        self.closed = False
        self.viewers = 0
        self.revision = 0
        self._feed = feed
        self._board = Board()
        self._now_us = now_us
        self._news = asyncio.Event()
        self._frames: dict[int, bytes] = {}

    async def run(self) -> None:
        """Turn until cancelled, and fetch what happened while nobody listened."""
        self._feed.start()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._catch_up())
                while True:
                    self.turn()
                    await asyncio.sleep(TURN_S)
        finally:
            await asyncio.to_thread(self._feed.close)

    def turn(self) -> None:
        """Take what came since the last turn and wake the viewers; an empty frame tells them that the line is up."""
        self.revision = max(self._now_us(), self.revision + 1)
        for heard in self._feed.drain():
            self._board.take(heard, self.revision)
        self._board.forget(self.revision)
        self._frames.clear()
        self._wake()

    def frame(self, since: int) -> bytes:
        """Return what changed after the revision `since` as a server-sent event; viewers of one revision share it."""
        if since > self.revision:
            since = 0
        if since not in self._frames:
            news = {
                "now_us": self.revision,
                "sites": self.sites,
                "link": asdict(self._feed.link),
                **self._board.delta(since),
            }
            data = json.dumps(news, separators=(",", ":"), allow_nan=False)
            self._frames[since] = f"id: {self.revision}\ndata: {data}\n\n".encode()
        return self._frames[since]

    async def news(self, since: int) -> None:
        """Wait for another revision than `since`, or the end."""
        while self.revision == since and not self.closed:
            await self._news.wait()

    def close(self) -> None:
        """Let every viewer go."""
        self.closed = True
        self._wake()

    async def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Ask the journals, without holding up a turn."""
        return await asyncio.to_thread(self._feed.history, sites, query)

    async def event(self, event_id: str) -> list[Event]:
        """Return every statement known of an event, oldest first; the journals are asked where its onset is not."""
        if not any(event.phase is Phase.ONSET and event.evidence for event in self._known(event_id)):
            stored = await self.history(self.sites, AlertsQuery(event=event_id, evidence=True, limit=LIMIT_MAX))
            for event in stored.events:
                self._board.take_event(event, self.revision + 1)
        return sorted(self._known(event_id), key=lambda event: event.detected_us)

    async def _catch_up(self) -> None:
        """Fetch the newest of the history whenever a link or an instance came up: some may not have been heard."""
        fetched, attempt = (0, 0), 0
        while True:
            due = (self._feed.link.connections, self._board.arrivals)
            if due != fetched and self._feed.link.connected:
                history = await self.history(self.sites, _CATCH_UP)
                for event in reversed(history.events):
                    self._board.take_event(event, self.revision + 1)
                if history.answers:
                    fetched, attempt = due, 0
                else:
                    await asyncio.sleep(_RETRY_S[min(attempt, len(_RETRY_S) - 1)])
                    attempt += 1
            await asyncio.sleep(TURN_S)

    def _known(self, event_id: str) -> list[Event]:
        return [event for event in self._board.statements if event.event_id == event_id]

    def _wake(self) -> None:
        self._news.set()
        self._news = asyncio.Event()
