"""A bus in memory, with the production inbox."""

from collections import deque
from dataclasses import dataclass, field

from headway.core.types.outcome import Outcome
from headway.edge.clock import Clock
from headway.edge.transport.message import ReceivedMessage
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import ReceiveQueue


@dataclass
class MemoryQuery:
    key: str
    parameters: dict[str, str] = field(default_factory=dict)
    answers: list[bytes] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    payload: bytes = b""

    def answer(self, payload: bytes, _encoding: str) -> None:
        self.answers.append(payload)

    def refuse(self, reason: str) -> None:
        self.refusals.append(reason)


class MemoryBus:
    """Keeps what was published; `deliver` stands for the callback of a real bus."""

    def __init__(self, receive_queue: ReceiveQueue, clock: Clock) -> None:
        self._receive_queue = receive_queue
        self._clock = clock
        self.published: list[tuple[Channel, str, bytes]] = []
        self.unwanted: set[Channel] = set()
        self.queries: deque[MemoryQuery] = deque()
        self.dropped: dict[str, int] = {}
        self.disconnected_subscribers = 0
        self.other_services: tuple[str, ...] = ()
        self.peers = 1
        self.connected = True
        self.subscribed = True
        self.delivered = True

    def deliver(self, received: ReceivedMessage) -> None:
        self._receive_queue.put([received])

    @property
    def received(self) -> int:
        return self._receive_queue.received

    @property
    def waiting(self) -> int:
        return len(self._receive_queue)

    @property
    def shed(self) -> int:
        return self._receive_queue.shed

    @property
    def shed_records(self) -> dict[Outcome, int]:
        return self._receive_queue.shed_records

    def wanted(self, channel: Channel) -> bool:
        return channel not in self.unwanted

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[ReceivedMessage]:
        return self._receive_queue.drain(limit, bytes_limit, now_ns)

    def wait(self, timeout_s: float) -> None:
        if not (self.waiting or self.queries):
            self._clock.sleep(timeout_s)

    def publish(self, channel: Channel, key: str, payload: bytes) -> None:
        self.published.append((channel, key, payload))

    def next_query(self) -> MemoryQuery | None:
        return self.queries.popleft() if self.queries else None

    def handovers(self) -> list[tuple[str, bytes]]:
        return []

    def unsubscribe(self) -> None:
        self.subscribed = False

    def on(self, channel: Channel) -> list[tuple[str, bytes]]:
        """What was published on one channel."""
        return [(key, payload) for c, key, payload in self.published if c is channel]
