"""Server-sent events for one browser."""

import asyncio

from starlette.types import Receive, Scope, Send

from headway.dashboard.broadcast import Hub


class EventStream:
    """ASGI response: frames for as long as the browser takes them.

    There is no queue. While a browser is slow to take a frame, what changes stays on the board, and its next frame
    holds the newest of everything.
    """

    def __init__(self, hub: Hub, since: int) -> None:
        self._hub = hub
        self._since = since

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send until the browser leaves or the hub closes."""
        del scope
        headers = [(b"content-type", b"text/event-stream")]
        await send({"type": "http.response.start", "status": 200, "headers": headers})
        gone = asyncio.create_task(_gone(receive))
        self._hub.viewers += 1
        try:
            await _send(send, b"retry: 1000\n\n")
            while not self._hub.closed and not gone.done():
                await self._hub.news(self._since)
                frame, self._since = self._hub.frame(self._since), self._hub.revision
                await _send(send, frame)
            await _send(send, b"", more=False)
        finally:
            self._hub.viewers -= 1
            gone.cancel()


async def _send(send: Send, body: bytes, *, more: bool = True) -> None:
    await send({"type": "http.response.body", "body": body, "more_body": more})


async def _gone(receive: Receive) -> None:
    while (await receive())["type"] != "http.disconnect":
        pass
