"""Messages between the bus, which delivers in a thread of its own, and the loop, which drains when it is ready."""

from collections import deque
from collections.abc import Callable

from headway.edge.arrival import Arrival


class Inbox:
    """A bounded queue for one thread that puts and one that drains; when it is full the stalest message is shed.

    Each counter has one writing thread, so none is lost and none needs a lock.

    Parameters
    ----------
    limit, bytes_limit
        Messages and bytes of payload that wait at most.
    records_in
        How many records a message that is shed would have been.
    """

    def __init__(self, limit: int, bytes_limit: int, records_in: Callable[[Arrival], int]) -> None:
        self._limit = limit
        self._bytes_limit = bytes_limit
        self._records_in = records_in
        self._queue: deque[Arrival] = deque()
        self._bytes_in = 0
        self._bytes_out = 0
        self.received = 0
        """Messages delivered so far."""
        self.shed = 0
        """Messages shed so far."""
        self.shed_records = 0
        """Records in them."""

    def __len__(self) -> int:
        """Messages waiting."""
        return len(self._queue)

    def put(self, arrival: Arrival) -> None:
        """Take a message in; only the bus's thread calls this."""
        self.received += 1
        self._bytes_in += len(arrival.payload)
        self._queue.append(arrival)
        while len(self._queue) > self._limit or self._bytes_in - self._bytes_out > self._bytes_limit:
            if not self._shed():
                break

    def drain(self, limit: int, bytes_limit: int) -> list[Arrival]:
        """Take out the oldest messages, up to `limit`, ending with the one that reaches `bytes_limit`."""
        taken: list[Arrival] = []
        take = self._queue.popleft
        size = 0
        try:
            while len(taken) < limit and size < bytes_limit:
                arrival = take()
                size += len(arrival.payload)
                taken.append(arrival)
        except IndexError:
            pass
        self._bytes_out += size
        return taken

    def _shed(self) -> bool:
        try:
            arrival = self._queue.popleft()
        except IndexError:  # the loop has just drained it
            return False
        self._bytes_in -= len(arrival.payload)
        self.shed += 1
        self.shed_records += self._records_in(arrival)
        return True
