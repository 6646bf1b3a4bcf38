"""The bus on zenoh. No other module of the service imports zenoh.

Messages arrive through a channel that the loop empties. A callback would run in a thread that competes with the loop
for the interpreter at each message. A loop without messages waits for the first one (`FirstSample`). The subscriber is
a plain one. An advanced subscriber recovers lost messages but costs 8 to 28 us a message, and a message recovered
seconds later is too old to score. Losses on the way show as gaps in the counters of the senders.

Alerts have a priority of their own and wait up to `block_timeout_s` for a slow network. To subscribers that connect
here they are put with BLOCK: one that takes nothing is disconnected. A client puts them with DROP. With BLOCK, a router
without the rules of `deploy/zenoh` would wait 5 s for one such subscriber, and all others with it. A subscriber that
misses an alert finds it in the history, by its sequence number. An advanced publisher could store alerts for late
subscribers, but it needs one publisher for each key, and the number of suspects has no bound. All other messages are
put with DROP.
"""

import json
import os
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any, Final

import structlog
import zenoh

from headway.core.types.outcome import Outcome
from headway.edge.clock import Clock
from headway.edge.fence import Fence
from headway.edge.transport.first_sample import FirstSample
from headway.edge.transport.lingering import end_lingering
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.other_services import OtherServices
from headway.edge.transport.ports import Channel, Query
from headway.edge.transport.receive_queue import ReceiveQueue
from headway.edge.transport.zenoh_config import BusConfig, BusError, is_client
from headway.edge.transport.zenoh_query import ZenohQuery
from headway.edge.worker import Worker
from headway.errors import zenoh_reason
from headway_schemas.keys import Keys

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: acc))")
"""zenoh reads this from the environment only. The thread that accepted a connection then reads it, and wakes no other.
At 80,000 messages a second this saves about 1 us each and lowers the 99th percentile by a third."""

_INCOMING_LIMIT: Final = 4_096
"""Messages that zenoh buffers for the loop; a sender of more within one iteration waits for its end."""
_TELEMETRY_LIMIT: Final = 20_000
"""Most states, copies and reports that wait to be put."""
_QUERY_LIMIT: Final = 64
"""Most queries, and most answers, that wait."""
_HANDOVER_LIMIT: Final = 4_096
"""Most states of vehicles from other sites that wait; beyond it the oldest is dropped, and its vehicle warms up."""
_BACKOFF_S: Final = (0.5, 10.0)
"""First and longest pause between two attempts to open."""
_RECEIVE_BYTES: Final = 64 << 20
"""Most bytes received at once, before the loop goes on."""
_CLOSED_AFTER_NS: Final = 5_000_000_000
"""zenoh reports the end of a connection within this time after the put that waited for it."""

_PRIORITY: Final = {
    Channel.ALERT: zenoh.Priority.INTERACTIVE_HIGH,
    Channel.HEALTH: zenoh.Priority.DATA_HIGH,
    Channel.HANDOVER: zenoh.Priority.INTERACTIVE_HIGH,
    Channel.HANDLING: zenoh.Priority.DATA_HIGH,
    Channel.STATE: zenoh.Priority.DATA_LOW,
    Channel.QUALITY: zenoh.Priority.DATA_LOW,
    Channel.REJECTED: zenoh.Priority.BACKGROUND,
}

_log: Final = structlog.get_logger(__name__)


class ZenohBus:
    """A `ports.Bus` on one zenoh session, which `open` starts.

    Parameters
    ----------
    fence
        The right to publish; None: nobody else has it.

    Raises
    ------
    BusError
        zenoh does not accept its configuration.
    """

    def __init__(
        self, config: BusConfig, keys: Keys, clock: Clock, receive_queue: ReceiveQueue, fence: Fence | None = None
    ) -> None:
        self._config = config
        self._fence = fence
        self._keys = keys
        self._clock = clock
        self._receive_queue = receive_queue
        self._queryables = (keys.pairs, keys.alerts, keys.handling) if config.history else (keys.pairs,)
        self._options = config.zenoh_config()
        self._is_client = is_client(self._options)
        self._listens = not self._is_client and bool(json.loads(self._options.get_json("listen/endpoints")))
        self._alerts = Worker("headway-alerts", config.alert_limit, zenoh.ZError)
        self._telemetry = Worker("headway-telemetry", _TELEMETRY_LIMIT, zenoh.ZError)
        self._answers = Worker("headway-answers", _QUERY_LIMIT, zenoh.ZError)
        self._workers = (self._alerts, self._telemetry, self._answers)
        self._queries: deque[Query] = deque()
        self._queries_dropped = 0
        self._handovers: deque[tuple[str, bytes]] = deque(maxlen=_HANDOVER_LIMIT)
        self._peers: set[str] = set()
        self._addresses: dict[str, str] = {}
        self._other_services = OtherServices(keys, clock)
        self._wanted = dict.fromkeys(Channel, True)
        self._incoming: zenoh.handlers.Handler[zenoh.Sample] | None = None
        self._first_sample: FirstSample | None = None
        self._polled_us = self._polled_ns = 0
        self._put_since_ns: int | None = None
        """Since when an alert is being put; None: none is."""
        self._blocked_ns: int | None = None
        """When the last put of an alert ended that had waited about as long as one may."""
        self.disconnected_subscribers = 0
        """Peers disconnected because they took no alerts."""
        self._session: zenoh.Session | None = None
        self._subscriber: zenoh.Subscriber[zenoh.handlers.Handler[zenoh.Sample]] | None = None
        self._declared: list[Any] = []

    def open(self, pause: Callable[[float], bool]) -> bool:
        """Open the session and subscribe; return False if `pause` ended the wait for a router.

        Parameters
        ----------
        pause
            Waits that many seconds and returns whether to continue.

        Raises
        ------
        BusError
            An address to listen on is not available.
        """
        wait_s, longest_s = _BACKOFF_S
        while self._session is None:
            try:
                self._session = zenoh.open(self._options)
            except zenoh.ZError as error:
                if not self._is_client:
                    raise BusError(f"zenoh: {zenoh_reason(error)}") from None
                _log.warning("no router yet", error=zenoh_reason(error), again_in_s=wait_s)
                if not pause(wait_s):
                    return False
                wait_s = min(2 * wait_s, longest_s)
        self._declare(self._session)
        return True

    def _declare(self, session: zenoh.Session) -> None:
        keys = self._keys
        self._polled_us, self._polled_ns = self._clock.local_us(), self._clock.monotonic_ns()
        self._declared = [
            session.info.declare_link_events_listener(self._on_link, history=True),
            session.info.declare_transport_events_listener(self._on_transport, history=True),
            self._watch_subscribers(session, Channel.STATE, keys.every_pair_state),
            self._watch_subscribers(session, Channel.QUALITY, keys.every_quality),
            self._watch_subscribers(session, Channel.REJECTED, keys.every_rejected),
            *(session.declare_queryable(key, self._query_handler(key)) for key in self._queryables),
            session.liveliness().declare_token(keys.liveliness(self._config.instance)),
        ]
        if self._fence is None:  # which would end one of them
            report, remote = self._other_services.report, zenoh.Locality.REMOTE
            self._declared.append(
                session.declare_subscriber(
                    keys.every_health, lambda of: report(str(of.key_expr)), allowed_origin=remote
                )
            )
        if self._config.handover:
            self._declared.append(session.declare_subscriber(keys.every_handover, self._on_handover))
        self._subscriber = session.declare_subscriber(keys.every_bsm, zenoh.handlers.FifoChannel(_INCOMING_LIMIT))
        self._incoming = self._subscriber.handler
        self._first_sample = FirstSample(self._incoming)

    def declare_epoch(self) -> None:
        """Show the epoch that the fence holds, and watch those of others."""
        if self._fence is None or self._session is None:
            return
        see, liveliness = self._fence.see, self._session.liveliness()
        self._declared += [
            liveliness.declare_token(self._keys.epoch(self._fence.epoch, self._config.instance)),
            liveliness.declare_subscriber(
                self._keys.every_epoch, lambda of: see(int(str(of.key_expr).split("/")[-2])), history=True
            ),
        ]

    @property
    def received(self) -> int:
        """Messages received so far."""
        return self._receive_queue.received

    @property
    def waiting(self) -> int:
        """Messages received that are neither drained nor shed."""
        return len(self._receive_queue)

    @property
    def shed(self) -> int:
        """Messages shed so far."""
        return self._receive_queue.shed

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in the shed messages, by reason."""
        return self._receive_queue.shed_records

    @property
    def dropped(self) -> Mapping[str, int]:
        """Messages to publish that were dropped, by reason."""
        return {
            "alert_queue_full": self._alerts.overflowed,
            "alert_failed": self._alerts.failed,
            "telemetry_queue_full": self._telemetry.overflowed,
            "telemetry_failed": self._telemetry.failed,
            "answer_queue_full": self._answers.overflowed + self._queries_dropped,
            "answer_failed": self._answers.failed,
        }

    @property
    def peers(self) -> int:
        """Peers, routers and clients connected."""
        return len(self._peers)

    @property
    def other_services(self) -> tuple[str, ...]:
        """Instances that judge the same site now."""
        return self._other_services.instances

    @property
    def connected(self) -> bool:
        """Whether senders can reach this service: it listens, or a peer is connected."""
        return self._session is not None and (self._listens or bool(self._peers))

    @property
    def subscribed(self) -> bool:
        """Whether the service receives messages."""
        return self._subscriber is not None

    def wanted(self, channel: Channel) -> bool:
        """Whether the channel has a subscriber."""
        return self._wanted[channel]

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[ReceivedMessage]:
        """Receive what zenoh buffers, then return the oldest messages."""
        self._receive()
        return self._receive_queue.drain(limit, bytes_limit, now_ns)

    def wait(self, timeout_s: float) -> None:
        """Wait for a message, a query or a change of the connection."""
        if self._first_sample is not None:
            self._first_sample.wait(timeout_s)
            self._polled_us, self._polled_ns = self._clock.local_us(), self._clock.monotonic_ns()

    def publish(self, channel: Channel, key: str, payload: bytes) -> None:
        """Queue a message, which another thread puts."""
        session = self._session
        if session is None:
            return
        is_alert = channel is Channel.ALERT
        worker = self._alerts if is_alert else self._telemetry
        is_blocking = is_alert and not self._is_client
        congestion = zenoh.CongestionControl.BLOCK if is_blocking else zenoh.CongestionControl.DROP

        def put() -> None:
            if self._fence is not None and not self._fence.permits():
                return
            if is_alert:
                self._put_since_ns = self._clock.monotonic_ns()
            try:
                session.put(
                    key, payload, encoding=channel.value, congestion_control=congestion, priority=_PRIORITY[channel]
                )
            finally:
                if is_alert:
                    if self._has_waited(self._put_since_ns):
                        self._blocked_ns = self._clock.monotonic_ns()
                    self._put_since_ns = None

        worker.put(put)

    def next_query(self) -> Query | None:
        """Return the oldest query, None if there is none."""
        return self._queries.popleft() if self._queries else None

    def handovers(self) -> list[tuple[str, bytes]]:
        """Return the states of vehicles that came since the last call, each with its key."""
        return [self._handovers.popleft() for _ in range(len(self._handovers))]

    def unsubscribe(self) -> None:
        """Receive nothing more; what zenoh already buffers is still delivered."""
        if self._subscriber is not None:
            self._subscriber.undeclare()
            self._subscriber = None

    @property
    def delivered(self) -> bool:
        """Whether, after `unsubscribe`, zenoh buffers nothing more."""
        return self._incoming is None

    def close(self) -> None:
        """Publish what waits and close; takes at most `block_timeout_s` and a second for each queue."""
        self.unsubscribe()
        if self._first_sample is not None:
            self._first_sample.close()
        unsent = [worker.name for worker in self._workers if not worker.close(self._config.block_timeout_s + 1.0)]
        for declared in self._declared:
            declared.undeclare()
        if self._session is not None:
            try:
                self._session.close()
            except zenoh.ZError as error:
                _log.warning("closed with messages unsent", workers=unsent, error=zenoh_reason(error))

    def _receive(self) -> None:
        """Receive what arrived since the last poll; its receive time is the middle between the two polls."""
        if self._incoming is None or self._first_sample is None:
            return
        local_us, monotonic_ns = self._clock.local_us(), self._clock.monotonic_ns()
        received_us, received_ns = (self._polled_us + local_us) // 2, (self._polled_ns + monotonic_ns) // 2
        self._polled_us, self._polled_ns = local_us, monotonic_ns
        first = self._first_sample.take()
        if first is None:
            return
        receive, new, kind_put = self._incoming.try_recv, tuple.__new__, zenoh.SampleKind.PUT
        messages, size, kept_bytes = [], 0, self._config.payload_max_bytes + 1
        try:
            while (sample := first.pop() if first else receive()) is not None:
                is_put = sample.kind == kind_put
                encoding = str(sample.encoding)
                payload = sample.payload
                size += len(payload)
                content = payload.to_bytes()[:kept_bytes]
                fields = (str(sample.key_expr), content, encoding, is_put, received_us, received_ns)
                messages.append(new(ReceivedMessage, fields))  # half the time of Arrival(...)
                if len(messages) == _INCOMING_LIMIT or size > _RECEIVE_BYTES:
                    break
        except zenoh.ZError:  # zenoh buffers nothing after `unsubscribe`
            self._incoming = None
        self._receive_queue.put(messages)

    def _on_handover(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            content = sample.payload.to_bytes()[: self._config.payload_max_bytes]
            self._handovers.append((str(sample.key_expr), content))

    def _query_handler(self, key: str) -> Callable[[zenoh.Query], None]:
        def ask(query: zenoh.Query) -> None:
            if len(self._queries) < _QUERY_LIMIT:
                self._queries.append(ZenohQuery(query, key, self._answers))
                self._wake()
            else:
                self._queries_dropped += 1
                query.drop()

        return ask

    def _wake(self) -> None:
        if self._first_sample is not None:
            self._first_sample.wake()

    def _watch_subscribers(self, session: zenoh.Session, channel: Channel, key: str) -> zenoh.Publisher:
        """Update `wanted` from the matching status of a publisher of the whole channel, which publishes nothing."""

        def on_match(status: zenoh.MatchingStatus) -> None:
            self._wanted[channel] = status.matching

        publisher = session.declare_publisher(key)
        self._wanted[channel] = False
        publisher.declare_matching_listener(on_match)
        return publisher

    def _on_link(self, event: zenoh.LinkEvent) -> None:
        if event.kind == zenoh.SampleKind.PUT:
            self._addresses[str(event.link.zid)] = str(event.link.dst)
            end_lingering()

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        peer = str(event.transport.zid)
        if event.kind == zenoh.SampleKind.PUT:
            self._peers.add(peer)
        else:
            self._peers.discard(peer)
            self._log_disconnected(peer)
        self._wake()

    def _has_waited(self, since_ns: int | None) -> bool:
        """Whether a put that began then has waited so long that zenoh is about to disconnect a peer."""
        return since_ns is not None and self._clock.monotonic_ns() - since_ns > 0.5e9 * self._config.block_timeout_s

    def _log_disconnected(self, peer: str) -> None:
        """Name a peer that is disconnected while an alert waits, or soon after one waited as long as one may."""
        blocked_ns = self._blocked_ns
        is_after = blocked_ns is not None and self._clock.monotonic_ns() - blocked_ns < _CLOSED_AFTER_NS
        if not (is_after or self._has_waited(self._put_since_ns)):
            return
        self._blocked_ns = None
        self.disconnected_subscribers += 1
        _log.warning(
            "subscriber disconnected: it took no alert for block_timeout_s",
            zenoh_id=peer, address=self._addresses.pop(peer, None), block_timeout_s=self._config.block_timeout_s,
        )  # fmt: skip
