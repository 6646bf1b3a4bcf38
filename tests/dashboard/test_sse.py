import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

from fake_service import START_US, FakeFeed, Traffic

from headway.dashboard.broadcast import Broadcaster
from headway.dashboard.sse import EventStream

Message = dict[str, Any]


def frames(sent: list[Message]) -> list[Message]:
    bodies = [m["body"].decode() for m in sent if m["type"] == "http.response.body"]
    return [json.loads(body.split("data: ")[1]) for body in bodies if "data: " in body]


def play(
    scenario: Callable[[Broadcaster, FakeFeed, asyncio.Event, list[Message]], Awaitable[None]],
) -> list[Message]:
    """Run a stream whose browser takes a message only while `reading` is set; it leaves when the scenario ends."""

    async def run() -> list[Message]:
        feed = FakeFeed()
        broadcaster = Broadcaster(feed, ["local"])
        broadcaster.refresh()
        sent: list[Message] = []
        reading, left = asyncio.Event(), asyncio.Event()
        reading.set()

        async def send(message: Any) -> None:
            await reading.wait()
            sent.append(message)

        async def receive() -> Message:
            await left.wait()
            return {"type": "http.disconnect"}

        stream = asyncio.create_task(EventStream(broadcaster, 0)({}, receive, send))
        await idle()
        await scenario(broadcaster, feed, reading, sent)
        left.set()
        broadcaster.refresh()
        await stream
        assert broadcaster.viewers == 0
        return sent

    return asyncio.run(run())


async def idle() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def test_a_viewer_is_told_everything_and_then_what_is_new() -> None:
    async def scenario(broadcaster: Broadcaster, feed: FakeFeed, *_: Any) -> None:
        assert broadcaster.viewers == 1
        for n in (2, 3):
            feed.deliver(*Traffic(n).states(0.0, START_US))
            broadcaster.refresh()
            await idle()

    shown = frames(play(scenario))
    assert [len(frame["pairs"]["rows"]) for frame in shown[:3]] == [0, 2, 3]


def test_a_slow_viewer_gets_one_frame_with_the_newest_of_everything() -> None:
    async def scenario(broadcaster: Broadcaster, feed: FakeFeed, reading: asyncio.Event, sent: list[Message]) -> None:
        reading.clear()
        for refresh in range(50):
            feed.deliver(*Traffic(4).states(0.0, START_US + refresh))
            broadcaster.refresh()
            await idle()
        before = len(frames(sent))
        reading.set()
        await idle()
        late = frames(sent)[before:]
        # The frame that was being sent when the viewer stopped reading, and one for all that came meanwhile.
        assert len(late) == 2
        assert [len(frame["pairs"]["rows"]) for frame in late] == [4, 4]
        assert {row[4] for row in late[1]["pairs"]["rows"]} == {START_US + 49}

    play(scenario)


def test_the_end_of_the_hub_ends_the_stream_in_order() -> None:
    async def scenario(broadcaster: Broadcaster, *_: Any) -> None:
        broadcaster.close()
        await idle()

    assert play(scenario)[-1] == {"type": "http.response.body", "body": b"", "more_body": False}
