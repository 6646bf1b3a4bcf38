"""The service on zenoh. Nothing else imports zenoh.

Senders are heard through a channel that the loop empties: a callback would be a thread that fights the loop for the
interpreter at every message. The subscriber is a plain one: an advanced one, which recovers what was lost, costs
7.7 us a message from one publisher and 28 from 200, and a message recovered seconds later is too old to be judged. What
is lost on the way shows as a gap in the sender's counter.

Alerts are put with BLOCK, at a priority of their own: they wait for a slow network rather than vanish, and a subscriber
that takes nothing is cut off after a while. An advanced publisher could keep some for those who come late, but needs
one for each key, and suspects have no end. All else is put with DROP.
"""

import json
import os
from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import structlog
import zenoh

from headway.core.types.outcome import Outcome
from headway.edge.clock import Clock
from headway.edge.transport.message import Arrival
from headway.edge.transport.ports import Channel, Query
from headway.edge.transport.receive_queue import Inbox
from headway.edge.worker import Outbox
from headway.errors import UserError
from headway_schemas.keys import Keys

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: acc))")
"""zenoh takes it from the environment alone. The thread that accepted a connection is told when something has come; by
default it wakes one of two others to read, which wait for each other besides. Read by itself, 80,000 messages a second
cost about 1 us less each, and their 99th percentile falls by a third or more."""

_INCOMING_LIMIT: Final = 4_096
"""Messages that zenoh holds for the loop; who sends more than that within a turn waits for the end of it."""
_TELEMETRY_LIMIT: Final = 20_000
"""States, copies and reports that wait to be put."""
_QUERY_LIMIT: Final = 64
"""Questions, and answers, that wait."""
_BACKOFF_S: Final = (0.5, 10.0)
"""First and longest pause between two attempts to open."""
_MESSAGE_BYTES_MAX: Final = 1 << 24
"""zenoh itself drops what is larger, so that nobody can make it ask for more memory than that."""

_PRIORITY: Final = {
    Channel.ALERT: zenoh.Priority.INTERACTIVE_HIGH,
    Channel.HEALTH: zenoh.Priority.DATA_HIGH,
    Channel.STATE: zenoh.Priority.DATA_LOW,
    Channel.REJECTED: zenoh.Priority.BACKGROUND,
}

_log: Final = structlog.get_logger(__name__)


class BusError(UserError):
    """zenoh refuses what it was configured for."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BusConfig:
    """How to be on the bus.

    `options` is zenoh's own configuration (JSON5), which decides wherever `mode`, `connect` and `listen` are None.
    """

    instance: str
    mode: str | None
    connect: tuple[str, ...] | None
    listen: tuple[str, ...] | None
    options: str | None
    connect_timeout_s: float
    block_timeout_s: float
    alert_limit: int
    history: bool = False
    """Whether questions for the history of events are taken."""

    def zenoh_config(self) -> zenoh.Config:
        """Return what zenoh makes of it. Raises `BusError`."""
        try:
            config = zenoh.Config.from_json5(self.options) if self.options else zenoh.Config()
            for key, value in self._inserted():
                config.insert_json5(key, json.dumps(value))
        except zenoh.ZError as error:
            raise BusError(f"zenoh options: {_brief(error)}") from None
        return config

    def _inserted(self) -> list[tuple[str, Any]]:
        block_us = int(self.block_timeout_s * 1e6)
        inserted: list[tuple[str, Any]] = [
            ("transport/shared_memory/enabled", False),
            ("transport/link/rx/max_message_size", _MESSAGE_BYTES_MAX),
            ("transport/link/tx/queue/congestion_control/block/wait_before_close", block_us),
            ("connect/retry", {"period_init_ms": 200, "period_max_ms": 2_000, "period_increase_factor": 2}),
        ]
        if self.options is None:
            inserted += [("scouting/multicast/enabled", False), ("scouting/gossip/enabled", False)]
        if self.mode is not None:
            inserted.append(("mode", self.mode))
        if self.mode == "client":
            inserted.append(("connect/timeout_ms", int(self.connect_timeout_s * 1e3)))
        if self.connect is not None:
            inserted.append(("connect/endpoints", list(self.connect)))
        if self.listen is not None:
            inserted.append(("listen/endpoints", [] if self.mode == "client" else list(self.listen)))
        return inserted


class ZenohBus:
    """A `ports.Bus` of one zenoh session; silent until `open`.

    Raises
    ------
    BusError
        zenoh does not understand its configuration.
    """

    def __init__(self, config: BusConfig, keys: Keys, clock: Clock, inbox: Inbox) -> None:
        self._config = config
        self._keys = keys
        self._clock = clock
        self._inbox = inbox
        self._asked = (keys.pairs, keys.alerts) if config.history else (keys.pairs,)
        self._options = config.zenoh_config()
        self._is_client = json.loads(self._options.get_json("mode")) == "client"
        self._listens = not self._is_client and bool(json.loads(self._options.get_json("listen/endpoints")))
        self._alerts = Outbox("headway-alerts", config.alert_limit, zenoh.ZError)
        self._telemetry = Outbox("headway-telemetry", _TELEMETRY_LIMIT, zenoh.ZError)
        self._answers = Outbox("headway-answers", _QUERY_LIMIT, zenoh.ZError)
        self._outboxes = (self._alerts, self._telemetry, self._answers)
        self._queries: deque[Query] = deque()
        self._queries_dropped = 0
        self._neighbours: set[str] = set()
        self._wanted = dict.fromkeys(Channel, True)
        self._incoming: zenoh.handlers.Handler[zenoh.Sample] | None = None
        self._looked_us = self._looked_ns = 0
        self._session: zenoh.Session | None = None
        self._subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self._declared: list[Any] = []

    def open(self, pause: Callable[[float], bool]) -> bool:
        """Open the session and subscribe; return False when `pause` said to stop before a router was there.

        Parameters
        ----------
        pause
            Waits that many seconds and returns whether to go on.

        Raises
        ------
        BusError
            An address to listen on cannot be had.
        """
        wait_s, longest_s = _BACKOFF_S
        while self._session is None:
            try:
                self._session = zenoh.open(self._options)
            except zenoh.ZError as error:
                if not self._is_client:
                    raise BusError(f"zenoh: {_brief(error)}") from None
                _log.warning("no router yet", error=_brief(error), again_in_s=wait_s)
                if not pause(wait_s):
                    return False
                wait_s = min(2 * wait_s, longest_s)
        self._declare(self._session)
        return True

    def _declare(self, session: zenoh.Session) -> None:
        keys = self._keys
        self._looked_us, self._looked_ns = self._clock.wall_us(), self._clock.monotonic_ns()
        self._declared = [
            session.info.declare_transport_events_listener(self._on_transport, history=True),
            self._watch(session, Channel.STATE, keys.every_pair_state),
            self._watch(session, Channel.REJECTED, keys.every_rejected),
            *(session.declare_queryable(key, self._asker(key)) for key in self._asked),
            session.liveliness().declare_token(keys.liveliness(self._config.instance)),
        ]
        self._subscriber = session.declare_subscriber(keys.every_bsm, zenoh.handlers.FifoChannel(_INCOMING_LIMIT))
        self._incoming = self._subscriber.handler

    @property
    def received(self) -> int:
        """Messages taken in so far."""
        return self._inbox.received

    @property
    def waiting(self) -> int:
        """Messages taken in and neither drained nor shed."""
        return len(self._inbox)

    @property
    def shed(self) -> int:
        """Messages shed so far."""
        return self._inbox.shed

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in them, by reason."""
        return self._inbox.shed_records

    @property
    def dropped(self) -> Mapping[str, int]:
        """What was to be told and was not, by reason."""
        return {
            "alert_queue_full": self._alerts.overflowed,
            "alert_failed": self._alerts.failed,
            "telemetry_queue_full": self._telemetry.overflowed,
            "telemetry_failed": self._telemetry.failed,
            "answer_queue_full": self._answers.overflowed + self._queries_dropped,
            "answer_failed": self._answers.failed,
        }

    @property
    def transports(self) -> int:
        """Neighbours connected."""
        return len(self._neighbours)

    @property
    def connected(self) -> bool:
        """Whether senders can reach this service: it listens, or a neighbour is there."""
        return self._session is not None and (self._listens or bool(self._neighbours))

    @property
    def subscribed(self) -> bool:
        """Whether messages are being taken in."""
        return self._subscriber is not None

    def wanted(self, channel: Channel) -> bool:
        """Whether anybody listens to the channel."""
        return self._wanted[channel]

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[Arrival]:
        """Take in what zenoh holds, and the oldest messages out."""
        self._take_in()
        return self._inbox.drain(limit, bytes_limit, now_ns)

    def publish(self, channel: Channel, key: str, payload: bytes) -> None:
        """Hand a message over to be put by another thread."""
        session = self._session
        if session is None:
            return
        is_alert = channel is Channel.ALERT
        outbox = self._alerts if is_alert else self._telemetry
        congestion = zenoh.CongestionControl.BLOCK if is_alert else zenoh.CongestionControl.DROP
        outbox.put(
            lambda: session.put(
                key, payload, encoding=channel.value, congestion_control=congestion, priority=_PRIORITY[channel]
            )
        )

    def next_query(self) -> Query | None:
        """Take the oldest question out."""
        return self._queries.popleft() if self._queries else None

    def unsubscribe(self) -> None:
        """Take nothing more in; what zenoh already holds is still delivered."""
        if self._subscriber is not None:
            self._subscriber.undeclare()
            self._subscriber = None

    @property
    def delivered(self) -> bool:
        """Whether, after `unsubscribe`, zenoh holds nothing more."""
        return self._incoming is None

    def close(self) -> None:
        """Say what waits to be said, sign off and close; takes no longer than a stalled subscriber's time to live."""
        self.unsubscribe()
        unsaid = [outbox.name for outbox in self._outboxes if not outbox.close(self._config.block_timeout_s + 1.0)]
        for declared in self._declared:
            declared.undeclare()
        if self._session is not None:
            try:
                self._session.close()
            except zenoh.ZError as error:
                _log.warning("closed with something unsaid", outboxes=unsaid, error=_brief(error))

    def _take_in(self) -> None:
        """Take in what has come since the last look, as if it had come half way between the two looks."""
        if self._incoming is None:
            return
        wall_us, monotonic_ns = self._clock.wall_us(), self._clock.monotonic_ns()
        received_us, received_ns = (self._looked_us + wall_us) // 2, (self._looked_ns + monotonic_ns) // 2
        self._looked_us, self._looked_ns = wall_us, monotonic_ns
        receive, new, kind_put = self._incoming.try_recv, tuple.__new__, zenoh.SampleKind.PUT
        arrivals = []
        try:
            while (sample := receive()) is not None:
                is_put = sample.kind == kind_put
                encoding = str(sample.encoding)
                fields = (str(sample.key_expr), sample.payload.to_bytes(), encoding, is_put, received_us, received_ns)
                arrivals.append(new(Arrival, fields))  # half the time of Arrival(...)
                if len(arrivals) == _INCOMING_LIMIT:
                    break
        except zenoh.ZError:  # nothing is under way after `unsubscribe`
            self._incoming = None
        self._inbox.put(arrivals)

    def _asker(self, key: str) -> Callable[[zenoh.Query], None]:
        def ask(query: zenoh.Query) -> None:
            if len(self._queries) < _QUERY_LIMIT:
                self._queries.append(_ZenohQuery(query, key, self._answers))
            else:
                self._queries_dropped += 1
                query.drop()

        return ask

    def _watch(self, session: zenoh.Session, channel: Channel, key: str) -> zenoh.Publisher:
        """Keep `wanted` up to date: a publisher of the whole channel, which publishes nothing, knows who matches."""

        def on_match(status: zenoh.MatchingStatus) -> None:
            self._wanted[channel] = status.matching

        publisher = session.declare_publisher(key)
        self._wanted[channel] = False
        publisher.declare_matching_listener(on_match)
        return publisher

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        neighbour = str(event.transport.zid)
        if event.kind == zenoh.SampleKind.PUT:
            self._neighbours.add(neighbour)
        else:
            self._neighbours.discard(neighbour)


class _ZenohQuery:
    def __init__(self, query: zenoh.Query, key: str, answers: Outbox) -> None:
        self._query = query
        self._answers = answers
        self.key = key
        self.parameters = {
            name: value for name, _, value in (p.partition("=") for p in str(query.parameters).split(";")) if name
        }

    def answer(self, payload: bytes, encoding: str) -> None:
        self._answers.put(lambda: self._reply(payload, encoding))

    def refuse(self, reason: str) -> None:
        self._answers.put(lambda: self._reply_error(reason))

    def _reply(self, payload: bytes, encoding: str) -> None:
        self._query.reply(self.key, payload, encoding=encoding)
        self._query.drop()

    def _reply_error(self, reason: str) -> None:
        self._query.reply_err(reason.encode(), encoding=zenoh.Encoding.TEXT_PLAIN)
        self._query.drop()


def _brief(error: Exception) -> str:
    """Leave out where in zenoh's sources an error arose."""
    return str(error).partition(" at /")[0].strip()
