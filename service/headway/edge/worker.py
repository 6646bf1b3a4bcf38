"""What is to be put on the bus, and the thread that puts it: a slow subscriber holds up this thread, not the loop."""

import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue


class Outbox:
    """A bounded queue of acts for a thread of its own; when it is full the oldest is dropped.

    Parameters
    ----------
    name
        Of the thread.
    limit
        Acts that wait at most.
    failure
        The exception by which an act fails; it is counted, and the thread goes on.
    """

    def __init__(self, name: str, limit: int, failure: type[Exception]) -> None:
        self.name = name
        self._limit = limit
        self._failure = failure
        self._acts: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()
        self.overflowed = 0
        """Acts dropped because too many waited."""
        self.failed = 0
        """Acts that failed."""

    def put(self, act: Callable[[], None]) -> None:
        """Have `act` done soon, after those before it."""
        if self._acts.qsize() >= self._limit:
            try:
                self._acts.get_nowait()
                self.overflowed += 1
            except Empty:  # the thread has just taken it
                pass
        self._acts.put(act)

    @property
    def waiting(self) -> int:
        """Acts that were not begun."""
        return self._acts.qsize()

    def close(self, timeout_s: float) -> bool:
        """Do what waits, for at most `timeout_s`; return whether all was done."""
        self._acts.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (act := self._acts.get()) is not None:
            try:
                act()
            except self._failure:
                self.failed += 1
