"""`headway dashboard`: the page as a process of its own."""

import asyncio
import contextlib
import logging
import socket
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import uvicorn
from uvicorn.protocols.http.h11_impl import H11Protocol

from headway.client import BusFeed, Feed
from headway.dashboard.access import is_loopback, read_token
from headway.dashboard.app import NO_FEATURES, Features, create_app
from headway.dashboard.broadcast import Broadcaster, wall_us
from headway.dashboard.contact import ContactNotice
from headway.dashboard.notifier import Notifier, Receivers
from headway.errors import UserError

STALL_S: Final = 20.0
HEADERS_S: Final = 10.0
"""A connection without a request for this long is closed."""
CONNECTIONS_MAX: Final = 256
"""Further requests are refused with status 503."""


def serve(
    *,
    connect: Sequence[str] = ("tcp/127.0.0.1:7447",),
    sites: Sequence[str] = ("local",),
    host: str = "127.0.0.1",
    port: int = 8080,
    token_file: Path | None = None,
    names: Sequence[str] = (),
    prefix: str = "v2x",
    zenoh_config: Path | None = None,
    receivers: Receivers | None = None,
    features: Features = NO_FEATURES,
) -> None:
    """Serve the page until SIGINT or SIGTERM; the bus may come and go meanwhile.

    `names` are further host names under which browsers reach the page. Port 0 takes a free one. `receivers` are sent
    notices of faulty vehicles.

    Raises
    ------
    UserError
        The address is not available, it is public and has no token, or an option is invalid.
    """
    if token_file is None and not is_loopback(host):
        raise UserError(f"{host} is reached from outside: name a file that holds a token with --token-file")
    token = None if token_file is None else read_token(token_file)
    feed = BusFeed(connect, sites, prefix=prefix, zenoh_config=zenoh_config)
    with bind(host, port) as listener:
        server = Server(feed, sites, host, token, names, ContactNotice("dashboard", connect), receivers, features)
        shown = f"[{host}]" if ":" in host else host
        sys.stderr.write(f"headway dashboard: http://{shown}:{listener.getsockname()[1]}/ of {', '.join(sites)}\n")
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:
            sys.stderr.write("\n")


class _Protocol(H11Protocol):
    """HTTP that does not wait for ever for the headers of a request."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Begin to watch the connection."""
        super().connection_made(transport)
        self.loop.call_later(HEADERS_S, self._close_unless_in_use)

    def _close_unless_in_use(self) -> None:
        if self.transport.is_closing():
            return
        if self.cycle is None or self.cycle.response_complete:
            self.transport.close()
        else:
            self.loop.call_later(HEADERS_S, self._close_unless_in_use)


class Server(uvicorn.Server):
    """Runs the broadcaster while the page is served."""

    def __init__(
        self,
        feed: Feed,
        sites: Sequence[str],
        host: str,
        token: str | None,
        names: Sequence[str],
        notice: ContactNotice | None = None,
        receivers: Receivers | None = None,
        features: Features = NO_FEATURES,
    ) -> None:
        self._feed = feed
        self._notice = notice
        self.broadcaster = Broadcaster(feed, sites)
        self._notifier = Notifier(receivers or Receivers(), self.broadcaster.view_state, wall_us)
        app = create_app(self.broadcaster, host=host, token=token, names=names, features=features)
        # The access log would contain the token of a first visit. The headers of a proxy are not verified.
        config = uvicorn.Config(
            app,
            access_log=False,
            log_level="warning",
            ws="none",
            http=_Protocol,
            limit_concurrency=CONNECTIONS_MAX,
            proxy_headers=False,
            server_header=False,
            timeout_graceful_shutdown=2,
        )
        super().__init__(config)

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start with the broadcaster; if that ends by itself it has failed, and the server stops."""
        await super().startup(sockets)
        self._running = asyncio.create_task(self._run())
        self._running.add_done_callback(lambda _: setattr(self, "should_exit", True))

    async def _run(self) -> None:
        async with asyncio.TaskGroup() as tasks:
            tasks.create_task(self.broadcaster.run())
            tasks.create_task(self._notifier.run())

    async def on_tick(self, counter: int) -> bool:
        """Update the notice of contact, ten times a second."""
        if self._notice is not None:
            self._notice.update(connected=self._feed.connection.connected)
        return await super().on_tick(counter)

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """Stop; the viewers first, because their connections stay open until the broadcaster closes."""
        self.broadcaster.close()
        # A request that still computes or waits for a journal is cancelled, and uvicorn would report that as an error.
        logging.getLogger("uvicorn.error").setLevel(logging.CRITICAL)
        await super().shutdown(sockets)
        self._running.cancel()
        with contextlib.suppress(asyncio.CancelledError):
            await self._running


def bind(host: str, port: int, stall_s: float = STALL_S) -> socket.socket:
    """Listen; the kernel drops a connection, with its buffers, if the browser takes nothing for `stall_s`."""
    try:
        family, *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        listener = socket.create_server(address, family=family)
    except (OSError, OverflowError) as error:
        problem = getattr(error, "strerror", None) or error
        raise UserError(f"cannot listen on {host} port {port}: {problem}") from None
    if sys.platform == "linux":
        listener.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, int(1_000 * stall_s))
    return listener
