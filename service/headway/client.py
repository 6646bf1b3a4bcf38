"""The bus as the views see it: a client that subscribes to what the service tells, and asks for its history."""

import contextlib
import json
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol, TypeAlias

import zenoh
from pydantic import ValidationError

from headway.errors import UserError
from headway_schemas import Event, Health, Keys, PairState, RejectedCopy
from headway_schemas.query import EVENTS, AlertsQuery

Message: TypeAlias = Event | PairState | Health | RejectedCopy

INBOX_LIMIT: Final = 50_000
"""Messages waiting on one channel of a site; beyond it the oldest is dropped and counted."""
_OPEN_TIMEOUT_MS: Final = 2_000
_RETRY_S: Final = 1.0
_QUERY_TIMEOUT_S: Final = 5.0


class Heard(NamedTuple):
    """A message and the site whose key it came under."""

    site: str
    message: Message


@dataclass(frozen=True, slots=True)
class History:
    """Events newest first, as far as anyone answered."""

    events: list[Event]
    answers: int
    """How many journals answered; 0 tells a missing service from an empty history."""
    problems: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Link:
    """How the views are connected."""

    connected: bool
    connections: int
    """Times that a link came up since the start."""
    dropped: int
    """Messages that came faster than they were taken."""
    unreadable: int
    """Messages that are not of the wire contract."""


class Feed(Protocol):
    """Where a view gets its messages from."""

    def start(self) -> None:
        """Begin to connect; returns at once."""

    def drain(self) -> Iterator[Heard]:
        """Take what came since the last call, channel by channel."""

    def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Ask the journals of these sites; blocks for some seconds at most."""

    @property
    def link(self) -> Link:
        """How the link stands."""

    def close(self) -> None:
        """Leave the bus."""


class _Inbox:
    """Bounded and filled by one callback, which copies and appends and nothing else."""

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
    """A zenoh client of some sites. It waits for the bus as long as it takes, and comes back after it.

    Raises
    ------
    UserError
        The endpoints, the sites or the configuration file are not usable.
    """

    def __init__(
        self,
        connect: Sequence[str],
        sites: Sequence[str],
        *,
        prefix: str = "v2x",
        zenoh_config: Path | None = None,
        inbox_limit: int = INBOX_LIMIT,
    ) -> None:
        try:
            self._keys = {site: Keys(prefix, site) for site in sites}
        except ValueError as error:
            raise UserError(str(error)) from None
        if not self._keys:
            raise UserError("no site: name at least one with --site")
        self._config = _configuration(connect, zenoh_config)
        self._inboxes: list[tuple[str, _Inbox]] = [
            (expression, _Inbox(site, model, inbox_limit))
            for site, keys in self._keys.items()
            for expression, model in (
                (keys.every_alert, Event),
                (keys.every_health, Health),
                (keys.every_pair_state, PairState),
                (keys.every_rejected, RejectedCopy),
            )
        ]
        self._session: zenoh.Session | None = None
        self._closing = threading.Event()
        self._opener = threading.Thread(target=self._open, name="bus", daemon=True)
        self._links = 0
        self._connections = 0
        self._unreadable = 0

    def start(self) -> None:
        """Begin to connect; returns at once."""
        self._opener.start()

    def drain(self) -> Iterator[Heard]:
        """Take what came since the last call, channel by channel."""
        for _, inbox in self._inboxes:
            for payload in inbox.drain():
                message = _read(inbox, payload)
                if message is None:
                    self._unreadable += 1
                else:
                    yield Heard(inbox.site, message)

    def history(self, sites: Sequence[str], query: AlertsQuery) -> History:
        """Ask the journals of these sites; blocks for some seconds at most."""
        events: dict[tuple[str, str, str, int], Event] = {}
        answers, problems = 0, []
        for site in sites:
            for reply in self._ask(self._keys[site], query):
                try:
                    answered = EVENTS.validate_json(_payload(reply))
                except ValueError as error:
                    problems.append(f"{site}: {str(error).splitlines()[0]}")
                    continue
                answers += 1
                events |= {(e.site, e.event_id, e.phase, e.detected_us): e for e in answered}
        newest_first = sorted(events.values(), key=lambda event: event.detected_us, reverse=True)
        return History(_page(newest_first, query.limit), answers, tuple(problems))

    @property
    def link(self) -> Link:
        """How the link stands."""
        return Link(
            connected=self._links > 0,
            connections=self._connections,
            dropped=sum(inbox.dropped for _, inbox in self._inboxes),
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
            session.info.declare_transport_events_listener(self._link_changed, history=True)
            for expression, inbox in self._inboxes:
                session.declare_subscriber(expression, inbox.put)
            self._session = session
            return

    def _link_changed(self, event: zenoh.TransportEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._links += 1
            self._connections += 1
        else:
            self._links -= 1

    def _ask(self, keys: Keys, query: AlertsQuery) -> Iterator[zenoh.Reply]:
        if self._session is None:
            return
        selector = f"{keys.alerts}?{query.to_parameters()}"
        with contextlib.suppress(zenoh.ZError):
            yield from self._session.get(selector, timeout=_QUERY_TIMEOUT_S, consolidation=zenoh.ConsolidationMode.NONE)


def _configuration(connect: Sequence[str], file: Path | None) -> zenoh.Config:
    try:
        config = zenoh.Config() if file is None else zenoh.Config.from_file(file)
        for path, value in _options(connect):
            config.insert_json5(path, json.dumps(value))
    except zenoh.ZError as error:
        raise UserError(f"bus: {str(error).splitlines()[0]}") from None
    return config


def _options(connect: Sequence[str]) -> Iterator[tuple[str, Any]]:
    yield "mode", "client"
    yield "connect/timeout_ms", _OPEN_TIMEOUT_MS
    yield "connect/retry", {"period_init_ms": 200, "period_max_ms": 1_000, "period_increase_factor": 2}
    yield "scouting/multicast/enabled", False
    yield "scouting/gossip/enabled", False
    yield "transport/shared_memory/enabled", False
    if connect:
        yield "connect/endpoints", list(connect)


def _read(inbox: _Inbox, payload: bytes) -> Message | None:
    try:
        message = inbox.model.model_validate_json(payload)
    except ValidationError:
        return None
    return message if getattr(message, "site", inbox.site) == inbox.site else None


def _payload(reply: zenoh.Reply) -> bytes:
    if reply.ok is not None:
        return reply.ok.payload.to_bytes()
    raise ValueError(reply.err.payload.to_string() if reply.err is not None else "an empty reply")


def _page(events: list[Event], limit: int) -> list[Event]:
    """Cut at `limit`, but never within one microsecond."""
    if len(events) <= limit:
        return events
    last_us = events[limit - 1].detected_us
    return [event for event in events if event.detected_us >= last_us]
