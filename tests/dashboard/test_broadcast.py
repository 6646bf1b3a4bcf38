import asyncio
import json
from collections.abc import Callable
from typing import Any

from standin import START_US, FakeFeed, Traffic, event, health

from headway.dashboard.broadcast import Hub
from headway_schemas import Kind, Phase, Sensor


def read(frame: bytes) -> dict[str, Any]:
    head, data = frame.decode().rstrip("\n").split("\n")
    news: dict[str, Any] = json.loads(data.removeprefix("data: "))
    assert head == f"id: {news['now_us']}"
    return news


def test_a_frame_holds_what_came_since() -> None:
    feed = FakeFeed()
    hub = Hub(feed, ["local"], now_us=lambda: 5)
    feed.hear(*Traffic(3).states(0.0, START_US))
    hub.turn()
    first = hub.revision
    feed.hear(event(1), health(1.0, START_US))
    hub.turn()
    news = read(hub.frame(first))
    assert (len(news["pairs"]["rows"]), len(news["statements"]), len(news["instances"])) == (0, 1, 1)
    assert len(read(hub.frame(0))["pairs"]["rows"]) == 3
    assert news["link"] == {"connected": True, "connections": 1, "dropped": 0, "unreadable": 0}


def test_revisions_rise_even_when_the_clock_does_not() -> None:
    hub = Hub(FakeFeed(), ["local"], now_us=lambda: 5)
    hub.turn()
    hub.turn()
    assert hub.revision == 6


def test_viewers_of_one_revision_share_a_frame() -> None:
    hub = Hub(FakeFeed(), ["local"])
    hub.turn()
    assert hub.frame(0) is hub.frame(0)


def test_a_revision_from_the_future_is_told_everything() -> None:
    feed = FakeFeed()
    hub = Hub(feed, ["local"], now_us=lambda: 5)
    feed.hear(*Traffic(3).states(0.0, START_US))
    hub.turn()
    assert len(read(hub.frame(10**9))["pairs"]["rows"]) == 3


class Watched(Hub):
    """Ends its run when something has come true after a turn."""

    def __init__(self, feed: FakeFeed, done: Callable[["Watched"], bool]) -> None:
        super().__init__(feed, ["local"])
        self._done = done
        self.reached = asyncio.Event()

    def turn(self) -> None:
        super().turn()
        if self._done(self):
            self.reached.set()

    @property
    def statements(self) -> list[Any]:
        told: list[Any] = read(self.frame(0))["statements"]
        return told


def run_until(feed: FakeFeed, done: Callable[[Watched], bool]) -> None:
    async def scenario() -> None:
        hub = Watched(feed, done)
        running = asyncio.create_task(hub.run())
        await asyncio.wait_for(hub.reached.wait(), 20)
        running.cancel()
        await asyncio.gather(running, return_exceptions=True)

    asyncio.run(scenario())


def test_what_happened_before_the_start_is_caught_up() -> None:
    feed = FakeFeed([event(n, t_us=START_US + n) for n in range(4)])
    run_until(feed, lambda hub: len(hub.statements) == 4)
    assert feed.started
    assert feed.closed


def test_an_instance_that_comes_back_is_asked_again_for_its_history() -> None:
    feed = FakeFeed([])

    def asked_twice(_: Hub) -> bool:
        if len(feed.asked) == 1:
            feed.hear(health(1.0, START_US))
        return len(feed.asked) == 2

    run_until(feed, asked_twice)


def test_a_journal_that_does_not_answer_is_asked_again() -> None:
    feed = FakeFeed(journal=None)

    def found_at_last(hub: Watched) -> bool:
        if feed.asked and feed.journal is None:
            feed.journal = [event(1)]
        return len(hub.statements) == 1

    run_until(feed, found_at_last)


def test_an_event_is_looked_up_in_the_journal_once() -> None:
    stored = [event(1), event(1, Phase.UPDATE, t_us=START_US + 1_000_000)]
    feed = FakeFeed(stored)
    hub = Hub(feed, ["local"])
    feed.hear(event(1, Phase.CLEARED, t_us=START_US + 2_000_000))
    hub.turn()
    for _ in range(2):
        statements = asyncio.run(hub.event("veh-0001-1"))
        assert [s.phase for s in statements] == [Phase.ONSET, Phase.UPDATE, Phase.CLEARED]
    assert len(feed.asked) == 1


def test_an_event_heard_from_its_onset_needs_no_journal() -> None:
    feed = FakeFeed([])
    hub = Hub(feed, ["local"])
    feed.hear(event(1))
    hub.turn()
    assert len(asyncio.run(hub.event("veh-0001-1"))) == 1
    assert feed.asked == []


def test_a_miss_has_no_evidence_and_is_shown_all_the_same() -> None:
    feed = FakeFeed([event(2, kind=Kind.MISS, sensor=Sensor.LINK)])
    hub = Hub(feed, ["local"])
    (statement,) = asyncio.run(hub.event("veh-0002-2"))
    assert statement.evidence is None
