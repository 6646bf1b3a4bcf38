"""A bounded queue of tasks and its thread: a slow subscriber or disk holds up this thread, not the loop."""

import threading
from collections.abc import Callable
from queue import Empty, SimpleQueue


class Worker:
    """A bounded queue of tasks with a thread of its own; when it is full the oldest task is dropped.

    Parameters
    ----------
    name
        Name of the thread.
    limit
        Most tasks that wait.
    failure
        The exception by which a task fails; it is counted, and the thread continues.
    """

    def __init__(self, name: str, limit: int, failure: type[Exception]) -> None:
        self.name = name
        self._limit = limit
        self._failure = failure
        self._tasks: SimpleQueue[Callable[[], None] | None] = SimpleQueue()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()
        self.overflowed = 0
        """Tasks dropped because too many waited."""
        self.failed = 0
        """Tasks that failed."""

    def put(self, task: Callable[[], None]) -> None:
        """Queue a task; tasks run in order."""
        if self._tasks.qsize() >= self._limit:
            try:
                self._tasks.get_nowait()
                self.overflowed += 1
            except Empty:  # the thread has just taken it
                pass
        self._tasks.put(task)

    @property
    def waiting(self) -> int:
        """Tasks that have not started."""
        return self._tasks.qsize()

    def close(self, timeout_s: float) -> bool:
        """Finish the queued tasks within `timeout_s`; return whether all are done."""
        self._tasks.put(None)
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        while (task := self._tasks.get()) is not None:
            try:
                task()
            except self._failure:
                self.failed += 1
