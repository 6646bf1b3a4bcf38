"""From the feed to any number of browsers: each one receives what changed since its last frame."""

import asyncio
import json
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict
from typing import Final

from headway.client import Feed, History
from headway.dashboard.event_summary import EventSummary
from headway.dashboard.view_state import ViewState
from headway_schemas import Event, Phase
from headway_schemas.handling import Handling, HandlingRequest
from headway_schemas.query import LIMIT_MAX, AlertsQuery

REFRESH_S: Final = 0.2
_CATCH_UP: Final = AlertsQuery(limit=LIMIT_MAX)
_RETRY_S: Final = (1.0, 2.0, 5.0, 10.0, 30.0)


def wall_us() -> int:
    """Return the wall clock, microseconds since 1970 UTC."""
    return time.time_ns() // 1000


class Broadcaster:
    """Owns the feed and the view state."""

    def __init__(self, feed: Feed, sites: Sequence[str], now_us: Callable[[], int] = wall_us) -> None:
        self.sites = tuple(sites)
        self.closed = False
        self.viewers = 0
        self.revision = 0
        self._feed = feed
        self.view_state = ViewState()
        self._now_us = now_us
        self._changed = asyncio.Event()
        self._frames: dict[int, bytes] = {}

    async def run(self) -> None:
        """Refresh until cancelled, and fetch the events from before the start and of gaps."""
        self._feed.start()
        try:
            async with asyncio.TaskGroup() as tasks:
                tasks.create_task(self._catch_up())
                while True:
                    self.refresh()
                    await asyncio.sleep(REFRESH_S)
        finally:
            await asyncio.to_thread(self._feed.close)

    def refresh(self) -> None:
        """Apply the new messages and wake the viewers; an empty frame shows them that the connection is up."""
        self.revision = max(self._now_us(), self.revision + 1)
        for received in self._feed.drain():
            self.view_state.apply(received, self.revision)
        self.view_state.evict(self.revision)
        self._frames.clear()
        self._wake()

    def frame(self, since: int) -> bytes:
        """Return what changed after the revision `since` as a server-sent event; viewers of one revision share it."""
        if since > self.revision:
            since = 0
        if since not in self._frames:
            changes = {
                "now_us": self.revision,
                "sites": self.sites,
                "connection": asdict(self._feed.connection),
                **self.view_state.delta(since),
            }
            data = json.dumps(changes, separators=(",", ":"), allow_nan=False)
            self._frames[since] = f"id: {self.revision}\ndata: {data}\n\n".encode()
        return self._frames[since]

    async def wait_for_change(self, since: int) -> None:
        """Wait for another revision than `since`, or the end."""
        while self.revision == since and not self.closed:
            await self._changed.wait()

    def close(self) -> None:
        """Disconnect every viewer."""
        self.closed = True
        self._wake()

    async def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Query the journals without holding up a refresh."""
        return await asyncio.to_thread(self._feed.history, sites, query)

    async def handle(self, site: str, request: HandlingRequest) -> Handling | str:
        """Ask the site for a handling; return it as stored, or the reason why it is not."""
        answer = await asyncio.to_thread(self._feed.handle, site, request)
        if isinstance(answer, Handling):
            self.view_state.apply_handling(answer, self.revision + 1)
        return answer

    def summary(self, event: Event) -> EventSummary:
        """Return what is known of the event of an update."""
        known = self.view_state.events.get((event.site, event.event_id))
        return EventSummary.of(event) if known is None else known

    async def event(self, event_id: str, sites: Sequence[str]) -> list[Event]:
        """Return every update of an event, oldest first; queries the journals if its onset is not here."""
        if not any(event.phase is Phase.ONSET and event.evidence for event in self._known(event_id, sites)):
            stored = await self.history(sites, AlertsQuery(event=event_id, evidence=True, limit=LIMIT_MAX))
            for event in stored.events:
                self.view_state.apply_event(event, self.revision + 1)
        return sorted(self._known(event_id, sites), key=lambda event: event.detected_us)

    async def _catch_up(self) -> None:
        """Fetch the newest history after each connection and each start of an instance: events may be missing."""
        fetched, attempt = (0, 0), 0
        while True:
            if self.view_state.missing:
                await self._fill_gap()
            due = (self._feed.connection.connections, self.view_state.instance_starts)
            if due != fetched and self._feed.connection.connected:
                history = await self.history(self.sites, _CATCH_UP)
                for event in reversed(history.events):
                    self.view_state.apply_event(event, self.revision + 1)
                for handling in await asyncio.to_thread(self._feed.handlings, self.sites):
                    self.view_state.apply_handling(handling, self.revision + 1)
                if history.answers:
                    fetched, attempt = due, 0
                else:
                    await asyncio.sleep(_RETRY_S[min(attempt, len(_RETRY_S) - 1)])
                    attempt += 1
            await asyncio.sleep(REFRESH_S)

    async def _fill_gap(self) -> None:
        """Fetch the updates of one gap; try again when no journal answers."""
        site, query = gap = self.view_state.missing.pop(0)
        history = await self.history([site], query)
        for event in reversed(history.events):
            self.view_state.apply_event(event, self.revision + 1)
        if not history.answers:
            self.view_state.missing.append(gap)

    def _known(self, event_id: str, sites: Sequence[str]) -> list[Event]:
        return [event for event in self.view_state.updates if event.event_id == event_id and event.site in sites]

    def _wake(self) -> None:
        self._changed.set()
        self._changed = asyncio.Event()
