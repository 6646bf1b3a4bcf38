"""Messages between the bus and the loop: bounded, and shared fairly among senders."""

from collections import Counter, deque
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Final

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage
from headway_schemas.keys import is_gateway

_UNIT_BYTES: Final = 4_096
"""A message counts once against the rate of its sender, and once more for each of these bytes."""
_WINDOW_NS: Final = 1_000_000_000
"""Over which the rate of a sender is counted."""

_KEY: Final = itemgetter(ReceivedMessage._fields.index("key"))
_PAYLOAD: Final = itemgetter(ReceivedMessage._fields.index("payload"))


class ReceiveQueue:
    """A bounded queue that sheds the messages of the busiest senders, oldest first.

    `put` refuses what a vehicle sends beyond its rate (`RATE_EXCEEDED`). When the queue is full it sheds (`SHED`) from
    the senders above their share, so that a flood does not displace the others. `drain` sheds what waited too long
    (`STALE`). So the messages that are processed are recent, however many arrive.

    Parameters
    ----------
    limit, bytes_limit
        Most messages, and most bytes of payload, that wait.
    age_limit_ns
        Longest wait of a message.
    records_in
        Counts the records in messages that are shed.
    sender_rate_hz
        Most messages a second under the key of one vehicle; a gateway has no limit of its own.
    """

    def __init__(
        self,
        limit: int,
        bytes_limit: int,
        age_limit_ns: int,
        records_in: Callable[[Sequence[ReceivedMessage]], int],
        sender_rate_hz: int = 100,
    ) -> None:
        self._limit = limit
        self._bytes_limit = bytes_limit
        self._age_limit_ns = age_limit_ns
        self._records_in = records_in
        self._sender_rate_hz = sender_rate_hz
        self._sent: dict[str, int] = {}
        """By key, in this window."""
        self._window_ns = 0
        self._queue: deque[ReceivedMessage] = deque()
        self._bytes = 0
        self.received = 0
        """Messages delivered so far."""
        self.shed = 0
        """Messages shed so far."""
        self._shed_records = {Outcome.SHED: 0, Outcome.STALE: 0, Outcome.RATE_EXCEEDED: 0}

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in what was shed, by reason."""
        return self._shed_records

    def __len__(self) -> int:
        """Messages waiting."""
        return len(self._queue)

    def put(self, messages: Sequence[ReceivedMessage]) -> None:
        """Append messages, oldest first."""
        self.received += len(messages)
        messages = self._within_rate(messages)
        self._bytes += _size(messages)
        self._queue.extend(messages)
        if len(self._queue) > self._limit or self._bytes > self._bytes_limit:
            self._shed_excess()

    def _within_rate(self, messages: Sequence[ReceivedMessage]) -> Sequence[ReceivedMessage]:
        """Return the messages that vehicles send within their rate; record the others."""
        if messages and messages[-1].received_ns - self._window_ns >= _WINDOW_NS:
            self._window_ns = messages[-1].received_ns
            self._sent.clear()
        sent, exceeding = self._sent, []
        for place, message in enumerate(messages):
            key = message[0]
            count = sent[key] = sent.get(key, 0) + 1 + len(message[1]) // _UNIT_BYTES
            if count > self._sender_rate_hz and not is_gateway(key.rpartition("/")[2]):
                exceeding.append(place)
        if not exceeding:
            return messages
        self._record_shed([messages[place] for place in exceeding], Outcome.RATE_EXCEEDED)
        refused = set(exceeding)
        return [message for place, message in enumerate(messages) if place not in refused]

    def _shed_excess(self) -> None:
        """Shed until the limits hold, oldest first: of the senders above their share first, then of all."""
        waiting = Counter(map(_KEY, self._queue))
        share = self._limit // len(waiting)
        shed: list[ReceivedMessage] = []
        for keep in (share, 0):
            kept: deque[ReceivedMessage] = deque()
            for message in self._queue:
                is_over = len(self._queue) - len(shed) > self._limit or self._bytes > self._bytes_limit
                if is_over and waiting[message.key] > keep:
                    waiting[message.key] -= 1
                    self._bytes -= len(message.payload)
                    shed.append(message)
                else:
                    kept.append(message)
            if len(kept) <= self._limit and self._bytes <= self._bytes_limit:
                break
        self._queue = kept
        self._record_shed(shed, Outcome.SHED)

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[ReceivedMessage]:
        """Remove and return the oldest messages, at most `limit`, ending with the one that reaches `bytes_limit`."""
        queue = self._queue
        stale = []
        while queue and now_ns - queue[0].received_ns > self._age_limit_ns:
            stale.append(queue.popleft())
        if stale:
            self._bytes -= _size(stale)
            self._record_shed(stale, Outcome.STALE)
        if len(queue) <= limit and self._bytes <= bytes_limit:
            taken = list(queue)
            queue.clear()
            self._bytes = 0
            return taken
        taken, size = [], 0
        while queue and len(taken) < limit and size < bytes_limit:
            taken.append(queue.popleft())
            size += len(taken[-1].payload)
        self._bytes -= size
        return taken

    def _record_shed(self, shed: Sequence[ReceivedMessage], reason: Outcome) -> None:
        self.shed += len(shed)
        self._shed_records[reason] += self._records_in(shed)


def _size(messages: Sequence[ReceivedMessage]) -> int:
    """Return bytes of payload."""
    return sum(map(len, map(_PAYLOAD, messages)))
