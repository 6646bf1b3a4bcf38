"""Messages between the bus, which delivers in a thread of its own, and the loop, which drains when it is ready."""

from collections import deque
from collections.abc import Callable, Mapping

from headway.core.outcome import Outcome
from headway.edge.arrival import Arrival


class Inbox:
    """A bounded queue for one thread that puts and one that drains; what is too much is shed, the stalest first.

    The one that puts sheds when the queue is full (`SHED`), the one that drains what waited for too long (`STALE`), so
    that what is judged is fresh however much comes in. Each counter has one writing thread, so none is lost and none
    needs a lock.

    Parameters
    ----------
    limit, bytes_limit
        Messages and bytes of payload that wait at most.
    age_limit_ns
        How long a message waits at most.
    records_in
        How many records a message that is shed would have been.
    """

    def __init__(self, limit: int, bytes_limit: int, age_limit_ns: int, records_in: Callable[[Arrival], int]) -> None:
        self._limit = limit
        self._bytes_limit = bytes_limit
        self._age_limit_ns = age_limit_ns
        self._records_in = records_in
        self._queue: deque[Arrival] = deque()
        self._bytes_in = 0
        self._bytes_out = 0
        self.received = 0
        """Messages delivered so far."""
        self._shed = self._shed_records = 0
        self._stale = self._stale_records = 0

    @property
    def shed(self) -> int:
        """Messages shed so far."""
        return self._shed + self._stale

    @property
    def shed_records(self) -> Mapping[Outcome, int]:
        """Records in them, by reason."""
        return {Outcome.SHED: self._shed_records, Outcome.STALE: self._stale_records}

    def __len__(self) -> int:
        """Messages waiting."""
        return len(self._queue)

    def put(self, arrival: Arrival) -> None:
        """Take a message in; only the bus's thread calls this."""
        self.received += 1
        self._bytes_in += len(arrival.payload)
        self._queue.append(arrival)
        while len(self._queue) > self._limit or self._bytes_in - self._bytes_out > self._bytes_limit:
            if not self._shed_one():
                break

    def drain(self, limit: int, bytes_limit: int, now_ns: int) -> list[Arrival]:
        """Take out the oldest messages, up to `limit`, ending with the one that reaches `bytes_limit`."""
        taken: list[Arrival] = []
        take = self._queue.popleft
        size = 0
        try:
            arrival = take()
            while now_ns - arrival.received_ns > self._age_limit_ns:
                self._bytes_out += len(arrival.payload)
                self._stale += 1
                self._stale_records += self._records_in(arrival)
                arrival = take()
            while True:
                size += len(arrival.payload)
                taken.append(arrival)
                if len(taken) >= limit or size >= bytes_limit:
                    break
                arrival = take()
        except IndexError:
            pass
        self._bytes_out += size
        return taken

    def _shed_one(self) -> bool:
        try:
            arrival = self._queue.popleft()
        except IndexError:  # the loop has just drained it
            return False
        self._bytes_in -= len(arrival.payload)
        self._shed += 1
        self._shed_records += self._records_in(arrival)
        return True
