"""Messages between the bus and the loop, which takes them in as they come and judges them when it is ready."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from operator import itemgetter
from typing import Final

from headway.core.types.outcome import Outcome
from headway.edge.transport.message import Arrival

_PAYLOAD: Final = itemgetter(Arrival._fields.index("payload"))


class Inbox:
    """A bounded queue; what is too much is shed, the stalest first.

    Whoever puts sheds when the queue is full (`SHED`), whoever drains what waited for too long (`STALE`), so that what
    is judged is fresh however much comes in.

    Parameters
    ----------
    limit, bytes_limit
        Messages and bytes of payload that wait at most.
    age_limit_ns
        How long a message waits at most.
    records_in
        How many records the messages that are shed would have been.
    """

    def __init__(
        self, limit: int, bytes_limit: int, age_limit_ns: int, records_in: Callable[[Sequence[Arrival]], int]
    ) -> None:
        self._limit = limit
        self._bytes_limit = bytes_limit
        self._age_limit_ns = age_limit_ns
        self._records_in = records_in
        self._queue: deque[Arrival] = deque()
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

    def put(self, arrivals: Sequence[Arrival]) -> None:
        """Take messages in, oldest first."""
        self.received += len(arrivals)
        self._bytes += _size(arrivals)
        queue = self._queue
        queue.extend(arrivals)
        if len(queue) > self._limit or self._bytes > self._bytes_limit:
            shed = []
            while len(queue) > self._limit or self._bytes > self._bytes_limit:
                shed.append(queue.popleft())
                self._bytes -= len(shed[-1].payload)
            self._book(shed, Outcome.SHED)

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[Arrival]:
        """Take out the oldest messages, up to `limit`, ending with the one that reaches `bytes_limit`."""
        queue = self._queue
        stale = []
        while queue and now_ns - queue[0].received_ns > self._age_limit_ns:
            stale.append(queue.popleft())
        if stale:
            self._bytes -= _size(stale)
            self._book(stale, Outcome.STALE)
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

    def _book(self, shed: Sequence[Arrival], reason: Outcome) -> None:
        self.shed += len(shed)
        self._shed_records[reason] += self._records_in(shed)


def _size(arrivals: Sequence[Arrival]) -> int:
    """Return bytes of payload."""
    return sum(map(len, map(_PAYLOAD, arrivals)))
