import asyncio
import json
from collections.abc import Callable
from typing import Any

from fake_service import START_US, FakeFeed, Traffic, event, health

from headway.dashboard.broadcast import Broadcaster
from headway_schemas import Kind, Phase, Sensor


def read(frame: bytes) -> dict[str, Any]:
    head, data = frame.decode().rstrip("\n").split("\n")
    changes: dict[str, Any] = json.loads(data.removeprefix("data: "))
    assert head == f"id: {changes['now_us']}"
    return changes


def test_a_frame_holds_what_came_since() -> None:
    feed = FakeFeed()
    broadcaster = Broadcaster(feed, ["local"], now_us=lambda: 5)
    feed.deliver(*Traffic(3).states(0.0, START_US))
    broadcaster.refresh()
    first = broadcaster.revision
    feed.deliver(event(1), health(1.0, START_US))
    broadcaster.refresh()
    changes = read(broadcaster.frame(first))
    assert (len(changes["pairs"]["rows"]), len(changes["events"]), len(changes["instances"])) == (0, 1, 1)
    assert len(read(broadcaster.frame(0))["pairs"]["rows"]) == 3
    assert changes["connection"] == {"connected": True, "connections": 1, "dropped": 0, "unreadable": 0}


def test_revisions_rise_even_when_the_clock_does_not() -> None:
    broadcaster = Broadcaster(FakeFeed(), ["local"], now_us=lambda: 5)
    broadcaster.refresh()
    broadcaster.refresh()
    assert broadcaster.revision == 6


def test_viewers_of_one_revision_share_a_frame() -> None:
    broadcaster = Broadcaster(FakeFeed(), ["local"])
    broadcaster.refresh()
    assert broadcaster.frame(0) is broadcaster.frame(0)


def test_a_revision_from_the_future_is_told_everything() -> None:
    feed = FakeFeed()
    broadcaster = Broadcaster(feed, ["local"], now_us=lambda: 5)
    feed.deliver(*Traffic(3).states(0.0, START_US))
    broadcaster.refresh()
    assert len(read(broadcaster.frame(10**9))["pairs"]["rows"]) == 3


class Watched(Broadcaster):
    """Ends its run when something has come true after a turn."""

    def __init__(self, feed: FakeFeed, done: Callable[["Watched"], bool]) -> None:
        super().__init__(feed, ["local"])
        self._done = done
        self.reached = asyncio.Event()

    def refresh(self) -> None:
        super().refresh()
        if self._done(self):
            self.reached.set()

    @property
    def events(self) -> list[Any]:
        shown: list[Any] = read(self.frame(0))["events"]
        return shown


def run_until(feed: FakeFeed, done: Callable[[Watched], bool]) -> None:
    async def scenario() -> None:
        broadcaster = Watched(feed, done)
        running = asyncio.create_task(broadcaster.run())
        await asyncio.wait_for(broadcaster.reached.wait(), 20)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(scenario())


def test_what_happened_before_the_start_is_caught_up() -> None:
    feed = FakeFeed([event(n, t_us=START_US + n) for n in range(4)])
    run_until(feed, lambda broadcaster: len(broadcaster.events) == 4)
    assert feed.started
    assert feed.closed


def test_an_instance_that_comes_back_is_asked_again_for_its_history() -> None:
    feed = FakeFeed([])

    def asked_twice(_: Broadcaster) -> bool:
        if len(feed.queries) == 1:
            feed.deliver(health(1.0, START_US))
        return len(feed.queries) == 2

    run_until(feed, asked_twice)


def test_a_journal_that_does_not_answer_is_asked_again() -> None:
    feed = FakeFeed(journal=None)

    def found_at_last(broadcaster: Watched) -> bool:
        if feed.queries and feed.journal is None:
            feed.journal = [event(1)]
        return len(broadcaster.events) == 1

    run_until(feed, found_at_last)


def test_an_event_is_looked_up_in_the_journal_once() -> None:
    stored = [event(1), event(1, Phase.UPDATE, t_us=START_US + 1_000_000)]
    feed = FakeFeed(stored)
    broadcaster = Broadcaster(feed, ["local"])
    feed.deliver(event(1, Phase.CLEARED, t_us=START_US + 2_000_000))
    broadcaster.refresh()
    for _ in range(2):
        updates = asyncio.run(broadcaster.event("veh-0001-1", ["local"]))
        assert [s.phase for s in updates] == [Phase.ONSET, Phase.UPDATE, Phase.CLEARED]
    assert len(feed.queries) == 1


def test_an_event_heard_from_its_onset_needs_no_journal() -> None:
    feed = FakeFeed([])
    broadcaster = Broadcaster(feed, ["local"])
    feed.deliver(event(1))
    broadcaster.refresh()
    assert len(asyncio.run(broadcaster.event("veh-0001-1", ["local"]))) == 1
    assert feed.queries == []


def test_a_miss_has_no_evidence_and_is_shown_all_the_same() -> None:
    feed = FakeFeed([event(2, kind=Kind.MISS, sensor=Sensor.LINK)])
    broadcaster = Broadcaster(feed, ["local"])
    (update,) = asyncio.run(broadcaster.event("veh-0002-2", ["local"]))
    assert update.evidence is None
