"""Server-sent events for one browser."""

import asyncio

from starlette.types import Receive, Scope, Send

from headway.dashboard.broadcast import Broadcaster


class EventStream:
    """ASGI response: frames until the browser disconnects.

    There is no queue. A slow browser skips frames, and its next frame holds the newest state.
    """

    def __init__(self, broadcaster: Broadcaster, since: int) -> None:
        self._broadcaster = broadcaster
        self._since = since

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the browser disconnects or the broadcaster closes."""
        del scope
        headers = [(b"content-type", b"text/event-stream")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        gone = asyncio.create_task(_gone(receive))
        self._broadcaster.viewers += 1
        try:
            await _send(send, b"retry: 1000\n\n")
            while not self._broadcaster.closed and not gone.done():
                await self._broadcaster.wait_for_change(self._since)
                frame, self._since = self._broadcaster.frame(self._since), self._broadcaster.revision
                await _send(send, frame)
            await _send(send, b"", more=False)
        finally:
            self._broadcaster.viewers -= 1
            gone.cancel()


async def _send(send: Send, body: bytes, *, more: bool = True) -> None:
    await send({"type": "http.response.body", "body": body, "more_body": more})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
