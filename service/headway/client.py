"""A client of the bus: subscribes to what the service publishes and queries its history.

`alerts` and `history` are all that most programs need. `BusFeed` is what they, the dashboard and `headway watch` share.
"""

import contextlib
import threading
import time
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple, Protocol, TypeAlias

import zenoh
from pydantic import ValidationError

from headway.bus_options import client_configuration
from headway.errors import UserError
from headway_schemas import Event, Health, Keys, PairState, RejectedCopy, SensorQuality
from headway_schemas.handling import HANDLINGS, Handling, HandlingRequest
from headway_schemas.query import EVENTS, LIMIT_MAX, AlertsQuery
from headway_schemas.sequence import SequenceGaps

Message: TypeAlias = Event | PairState | Health | RejectedCopy | SensorQuality | Handling

BUFFER_LIMIT: Final = 50_000
"""Most messages that wait on one channel of a site; beyond it the oldest is dropped and counted."""
DEFAULT_ENDPOINT: Final = "tcp/127.0.0.1:7447"
DEFAULT_SITE: Final = "local"
_POLL_S: Final = 0.02
_RETRY_S: Final = 1.0
_QUERY_TIMEOUT_S: Final = 5.0


class SiteMessage(NamedTuple):
    """A message and the site of its key."""

    site: str
    message: Message


@dataclass(frozen=True, slots=True)
class History:
    """Events of the journals that answered, newest first."""

    events: list[Event]
    answers: int
    """Journals that answered; 0 means no service, not an empty history."""
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Connection:
    """State of the connection to the bus."""

    connected: bool
    connections: int
    """Connections made since the start."""
    dropped: int
    """Messages dropped because they arrived faster than they were drained."""
    unreadable: int
    """Messages that do not follow the wire contract."""


class Feed(Protocol):
    """Source of messages for a view."""

    def start(self) -> None:
        """Start to connect; returns at once."""

    def drain(self) -> Iterator[SiteMessage]:
        """Yield the messages since the last call, channel by channel."""

    def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Query the journals of these sites; blocks for at most some seconds."""

    def handlings(self, sites: Sequence[str]) -> list[Handling]:
        """Query how people handle the vehicles of these sites; blocks for at most some seconds."""

    def handle(self, site: str, request: HandlingRequest) -> Handling | str:
        """Ask for a handling; return it as stored, or the reason why it is not. Blocks as `history` does."""

    @property
    def connection(self) -> Connection:
        """State of the connection."""

    def close(self) -> None:
        """Leave the bus."""


def alerts(
    connect: str | Sequence[str] = DEFAULT_ENDPOINT,
    *,
    site: str | Sequence[str] = DEFAULT_SITE,
    prefix: str = "v2x",
    zenoh_config: Path | None = None,
    timeout_s: float | None = None,
) -> Iterator[Event]:
    """Yield the event updates of running services as they are published.

    Where a gap in `sequence` shows that updates were missed, those that the history holds come first. An update may
    come twice: a service that was killed publishes its last ones again.

    Parameters
    ----------
    connect
        zenoh endpoint of a service or a router, or several.
    site
        Site to listen to, or several.
    prefix
        First chunks of every key, as the service's setting `prefix`.
    zenoh_config
        JSON5 file of zenoh's own options, such as certificates.
    timeout_s
        Ends after so many seconds without an event update; None never ends, and waits for the bus without a limit.

    Raises
    ------
    headway.errors.UserError
        An endpoint, a site or the file is invalid.

    Examples
    --------
    >>> for event in alerts("tcp/127.0.0.1:7999", timeout_s=0.1):
    ...     print(event.phase, event.kind, event.sensor, event.suspect)
    """
    feed = BusFeed(_listed(connect), _listed(site), prefix=prefix, zenoh_config=zenoh_config, messages=(Event,))
    gaps = SequenceGaps()
    with _running(feed):
        last_s = time.monotonic()
        while timeout_s is None or time.monotonic() < last_s + timeout_s:
            for received in feed.drain():
                last_s = time.monotonic()
                if isinstance(event := received.message, Event):
                    after = gaps.missing_after(event)
                    if after is not None:
                        yield from _missed(feed, event, after)
                    yield event
            time.sleep(_POLL_S)


def history(
    query: AlertsQuery | None = None,
    connect: str | Sequence[str] = DEFAULT_ENDPOINT,
    *,
    site: str | Sequence[str] = DEFAULT_SITE,
    prefix: str = "v2x",
    zenoh_config: Path | None = None,
    timeout_s: float = 5.0,
) -> History:
    """Ask the journals of running services for event updates, newest first.

    `query` holds the conditions; without it, these are the newest 100. The other parameters are those of `alerts`, and
    `timeout_s` is how long to wait for the connection.

    Raises
    ------
    headway.errors.UserError
        An endpoint, a site or the file is invalid.

    Examples
    --------
    >>> history(AlertsQuery(limit=5), "tcp/127.0.0.1:7999", timeout_s=0.1).answers
    0
    """
    sites = _listed(site)
    feed = BusFeed(_listed(connect), sites, prefix=prefix, zenoh_config=zenoh_config, messages=())
    with _running(feed):
        give_up_s = time.monotonic() + timeout_s
        while not feed.connection.connected and time.monotonic() < give_up_s:
            time.sleep(_POLL_S)
        return feed.history(sites, query or AlertsQuery())


def _missed(feed: Feed, event: Event, after: int) -> Iterator[Event]:
    """Yield the updates of the instance between a sequence number and that of an event, as the history holds them."""
    query = AlertsQuery(instance=event.instance, after_sequence=after, limit=LIMIT_MAX)
    updates = {update.sequence or 0: update for update in feed.history([event.site], query).events}
    yield from (updates[number] for number in sorted(updates) if number < (event.sequence or 0))


def _listed(value: str | Sequence[str]) -> Sequence[str]:
    return (value,) if isinstance(value, str) else value


class _Buffer:
    """A bounded queue that one callback fills; it only copies and appends."""

    def __init__(self, site: str, model: type[Message], limit: int) -> None:
        self.site = site
        self.model = model
        self.dropped = 0
        self._limit = limit
        self._payloads: deque[bytes] = deque()

    def put(self, sample: zenoh.Sample) -> None:
        if sample.kind != zenoh.SampleKind.PUT:
            return
        if len(self._payloads) >= self._limit:
            with contextlib.suppress(IndexError):
                self._payloads.popleft()
                self.dropped += 1
        self._payloads.append(sample.payload.to_bytes())

    def drain(self) -> Iterator[bytes]:
        for _ in range(len(self._payloads)):
            with contextlib.suppress(IndexError):
                yield self._payloads.popleft()


class BusFeed:
    """A zenoh client of some sites, for some kinds of messages. It waits for the bus without a limit and reconnects.

    Raises
    ------
    UserError
        The endpoints, the sites or the configuration file are invalid.
    """

    def __init__(
        self,
        connect: Sequence[str],
        sites: Sequence[str],
        *,
        prefix: str = "v2x",
        zenoh_config: Path | None = None,
        messages: Sequence[type[Message]] = (Event, Health, PairState, RejectedCopy, SensorQuality, Handling),
        buffer_limit: int = BUFFER_LIMIT,
    ) -> None:
        try:
            self._keys = {site: Keys(prefix, site) for site in sites}
        except ValueError as error:
            raise UserError(str(error)) from None
        if not self._keys:
            raise UserError("no site: name at least one with --site")
        self._config = client_configuration(connect, zenoh_config)
        self._buffers: list[tuple[str, _Buffer]] = [
            (expression, _Buffer(site, model, buffer_limit))
            for site, keys in self._keys.items()
            for expression, model in (
                (keys.every_alert, Event),
                (keys.every_pair_state, PairState),
                (keys.every_rejected, RejectedCopy),
                (keys.every_quality, SensorQuality),
                (keys.every_handled, Handling),
                (keys.every_health, Health),  # the last: once health arrives, all the others do
            )
            if model in messages
        ]
        self._session: zenoh.Session | None = None
        self._closing = threading.Event()
        self._opener = threading.Thread(target=self._open, name="bus", daemon=True)
        self._peers = 0
        self._connections = 0
        self._unreadable = 0

    def start(self) -> None:
        """Start to connect; returns at once."""
        self._opener.start()

    def drain(self) -> Iterator[SiteMessage]:
        """Yield the messages since the last call, channel by channel."""
        for _, buffer in self._buffers:
            for payload in buffer.drain():
                message = _read(buffer, payload)
                if message is None:
                    self._unreadable += 1
                else:
                    yield SiteMessage(buffer.site, message)

    def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Query the journals of these sites; blocks for at most some seconds."""
        events: dict[tuple[str, str, str, int], Event] = {}
        answers, problems = 0, []
        for site in sites:
            for reply in self._query(f"{self._keys[site].alerts}?{query.to_parameters()}"):
                try:
                    answered = EVENTS.validate_json(_payload(reply))
                except ValueError as error:
                    problems.append(f"{site}: {str(error).splitlines()[0]}")
                    continue
                answers += 1
                events |= {(e.site, e.event_id, e.phase, e.detected_us): e for e in answered}
        newest_first = sorted(events.values(), key=lambda event: event.detected_us, reverse=True)
        return History(_page(newest_first, query.limit), answers, tuple(problems))

    def handlings(self, sites: Sequence[str]) -> list[Handling]:
        """Query how people handle the vehicles of these sites; blocks for at most some seconds."""
        found = []
        for site in sites:
            for reply in self._query(self._keys[site].handling):
                with contextlib.suppress(ValueError):
                    found += HANDLINGS.validate_json(_payload(reply))
        return sorted(found, key=lambda handling: handling.t_us)

    def handle(self, site: str, request: HandlingRequest) -> Handling | str:
        """Ask for a handling; return it as stored, or the reason why it is not. Blocks as `history` does."""
        problem = f"no journal of site {site} answers; is its state_dir set?"
        for reply in self._query(self._keys[site].handling, request.model_dump_json().encode()):
            try:
                return HANDLINGS.validate_json(_payload(reply))[0]
            except ValueError as error:
                problem = str(error).splitlines()[0]
        return problem

    @property
    def connection(self) -> Connection:
        """State of the connection."""
        return Connection(
            connected=self._peers > 0,
            connections=self._connections,
            dropped=sum(buffer.dropped for _, buffer in self._buffers),
            unreadable=self._unreadable,
        )

    def close(self) -> None:
        """Leave the bus."""
        self._closing.set()
        if self._opener.ident is not None:
            self._opener.join()
        if self._session is not None:
            self._session.close()

    def _open(self) -> None:
        while not self._closing.is_set():
            try:
                session = zenoh.open(self._config)
            except zenoh.ZError:
                self._closing.wait(_RETRY_S)
                continue
            session.info.declare_transport_events_listener(self._on_transport, history=True)
            for expression, buffer in self._buffers:
                session.declare_subscriber(expression, buffer.put)
            self._session = session
            return

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._peers += 1
            self._connections += 1
        else:
            self._peers -= 1

    def _query(self, selector: str, payload: bytes | None = None) -> Iterator[zenoh.Reply]:
        if self._session is None:
            return
        with contextlib.suppress(zenoh.ZError):
            yield from self._session.get(
                selector, payload=payload, timeout=_QUERY_TIMEOUT_S, consolidation=zenoh.ConsolidationMode.NONE
            )


@contextlib.contextmanager
def _running(feed: BusFeed) -> Iterator[None]:
    feed.start()
    try:
        yield
    finally:
        feed.close()


def _read(buffer: _Buffer, payload: bytes) -> Message | None:
    try:
        message = buffer.model.model_validate_json(payload)
    except ValidationError:
        return None
    return message if getattr(message, "site", buffer.site) == buffer.site else None


def _payload(reply: zenoh.Reply) -> bytes:
    if reply.ok is not None:
        return reply.ok.payload.to_bytes()
    raise ValueError(reply.err.payload.to_string() if reply.err is not None else "an empty reply")


def _page(events: list[Event], limit: int) -> list[Event]:
    """Cut at `limit`, but never between events of one microsecond."""
    if len(events) <= limit:
        return events
    last_us = events[limit - 1].detected_us
    return [event for event in events if event.detected_us >= last_us]
