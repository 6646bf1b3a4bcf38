import asyncio
import json
from collections.abc import Awaitable, Callable
from typing import Any

from standin import START_US, FakeFeed, Traffic

from headway.dashboard.broadcast import Hub
from headway.dashboard.sse import EventStream

Message = dict[str, Any]


def frames(sent: list[Message]) -> list[Message]:
    bodies = [m["body"].decode() for m in sent if m["type"] == "http.response.body"]
    return [json.loads(body.split("data: ")[1]) for body in bodies if "data: " in body]


def play(
    scenario: Callable[[Hub, FakeFeed, asyncio.Event, list[Message]], Awaitable[None]],
) -> list[Message]:
    """Run a stream whose browser takes a message only while `reading` is set; it leaves when the scenario ends."""

    async def run() -> list[Message]:
        feed = FakeFeed()
        hub = Hub(feed, ["local"])
        hub.turn()
        sent: list[Message] = []
        reading, left = asyncio.Event(), asyncio.Event()
        reading.set()

        async def send(message: Any) -> None:
            await reading.wait()
            sent.append(message)

        async def receive() -> Message:
            await left.wait()
            return {"type": "http.disconnect"}

        stream = asyncio.create_task(EventStream(hub, 0)({}, receive, send))
        await settle()
        await scenario(hub, feed, reading, sent)
        left.set()
        hub.turn()
        await stream
        assert hub.viewers == 0
        return sent

    return asyncio.run(run())


async def settle() -> None:
    for _ in range(10):
        await asyncio.sleep(0)


def test_a_viewer_is_told_everything_and_then_what_is_new() -> None:
    async def scenario(hub: Hub, feed: FakeFeed, *_: Any) -> None:
        assert hub.viewers == 1
        for n in (2, 3):
            feed.hear(*Traffic(n).states(0.0, START_US))
            hub.turn()
            await settle()

    told = frames(play(scenario))
    assert [len(frame["pairs"]["rows"]) for frame in told[:3]] == [0, 2, 3]


def test_a_slow_viewer_gets_one_frame_with_the_newest_of_everything() -> None:
    async def scenario(hub: Hub, feed: FakeFeed, reading: asyncio.Event, sent: list[Message]) -> None:
        reading.clear()
        for turn in range(50):
            feed.hear(*Traffic(4).states(0.0, START_US + turn))
            hub.turn()
            await settle()
        before = len(frames(sent))
        reading.set()
        await settle()
        late = frames(sent)[before:]
        # The frame that was being sent when the viewer stopped reading, and one for all that came meanwhile.
        assert len(late) == 2
        assert [len(frame["pairs"]["rows"]) for frame in late] == [4, 4]
        assert {row[4] for row in late[1]["pairs"]["rows"]} == {START_US + 49}

    play(scenario)


def test_the_end_of_the_hub_ends_the_stream_in_order() -> None:
    async def scenario(hub: Hub, *_: Any) -> None:
        hub.close()
        await settle()

    assert play(scenario)[-1] == {"type": "http.response.body", "body": b"", "more_body": False}
