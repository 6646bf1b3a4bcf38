"""Messages between the bus and the loop."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Final

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import ReceivedMessage

_PAYLOAD: Final = itemgetter(ReceivedMessage._fields.index("payload"))


class ReceiveQueue:
    """A bounded queue that sheds the oldest messages.

    `put` sheds when the queue is full (`SHED`). `drain` sheds what waited too long (`STALE`). So the messages that
    are processed are recent, however many arrive.

    Parameters
    ----------
    limit, bytes_limit
        Most messages, and most bytes of payload, that wait.
    age_limit_ns
        Longest wait of a message.
    records_in
        Counts the records in messages that are shed.
    """

    def __init__(
        self, limit: int, bytes_limit: int, age_limit_ns: int, records_in: Callable[[Sequence[ReceivedMessage]], int]
    ) -> None:
        self._limit = limit
        self._bytes_limit = bytes_limit
        self._age_limit_ns = age_limit_ns
        self._records_in = records_in
        self._queue: deque[ReceivedMessage] = deque()
        self._bytes = 0
        self.received = 0
        """Messages delivered so far."""
        self.shed = 0
        """Messages shed so far."""
        self._shed_records = {Outcome.SHED: 0, Outcome.STALE: 0}

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
        self._bytes += _size(messages)
        queue = self._queue
        queue.extend(messages)
        if len(queue) > self._limit or self._bytes > self._bytes_limit:
            shed = []
            while len(queue) > self._limit or self._bytes > self._bytes_limit:
                shed.append(queue.popleft())
                self._bytes -= len(shed[-1].payload)
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
