"""A thread that commits event updates to the journal and then publishes them."""

import math
import sqlite3
import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Final, TypeVar

import structlog

from headway.edge.clock import Clock
from headway.edge.storage.journal import PRUNE_AT_ONCE, EventUpdate, Journal, Resumed
from headway.edge.storage.journal_format import Reason, reason_of

WAITING_MAX: Final = 2_000
"""Most event updates that wait for the disk: about 20 MB."""
PUBLISH_AFTER_NS: Final = 1_000_000_000
"""An update that has waited this long for its commit is published before it."""
CHECK_NS: Final = 1_000_000_000
"""How often the file is checked: that it is there, and that it can be read."""
ON_BUS_AFTER_NS: Final = 2_000_000_000
"""An update handed to the bus is taken to be there after this long; one of a process killed before is sent again."""
LEAP_US: Final = 86_400_000_000
AGEING_AFTER_NS: Final = 3_600_000_000_000
"""When the clock is more than a day after the newest update at the start, nothing is deleted for its age this long: the
clock of a machine that has just started may be wrong."""
_IDLE_S: Final = 1.0
"""After this long without an update the thread prunes."""

_T = TypeVar("_T")
_log: Final = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class _Batch:
    """The updates of one loop iteration. The thread that takes one out of `unpublished` publishes it, so once."""

    updates: Sequence[EventUpdate]
    put_ns: int
    unpublished: deque[EventUpdate] = field(default_factory=deque)


class JournalWriter:
    """Commits the updates of each loop iteration in one transaction and then publishes them, in order.

    The loop calls `put` and `tick`; neither waits. If the disk fails, the updates are published without a commit and
    counted under the reason. If it does not answer, they are published after a second and written when it does.

    Parameters
    ----------
    journal
        Where to write.
    publish
        Publishes one update; any thread may call it.
    """

    def __init__(self, journal: Journal, publish: Callable[[EventUpdate], None], clock: Clock) -> None:
        self._journal = journal
        self._publish = publish
        self._clock = clock
        self._queue: SimpleQueue[_Batch | None] = SimpleQueue()
        self._unpublished: deque[_Batch] = deque()
        self._put = self._taken = self._overflowed = self._prune_debt = 0
        self._handed: deque[tuple[int, int]] = deque()
        self._ageing_ns = self._checked_ns = clock.monotonic_ns()
        self._is_damaged = False
        self.written = 0
        """Updates written to the journal."""
        self.failed: Counter[Reason] = Counter(dict.fromkeys(Reason, 0))
        """Updates that could not be written, by reason."""
        self.published_before_commit = 0
        """Updates published before they were written."""
        self.pruned = 0
        """Rows deleted or reduced."""
        self.replaced = 0
        """Times a new file had to be made, because the old one was deleted or damaged."""
        self.trouble: Reason | None = None
        """Why the newest attempt failed; None: it succeeded."""
        self._thread = threading.Thread(target=self._run, name="headway-journal", daemon=True)

    def start(self) -> Resumed:
        """Start the thread; return what the process before this one left."""
        now_us = self._clock.wall_us()
        try:
            resumed = self._journal.resume()
        except (sqlite3.Error, OSError) as error:
            _log.warning("journal cannot be resumed", reason=reason_of(error), error=str(error))
            resumed = Resumed()
        if resumed.newest_us and now_us - resumed.newest_us > LEAP_US:
            self._ageing_ns += AGEING_AFTER_NS
            days = round((now_us - resumed.newest_us) / LEAP_US)
            _log.warning("nothing is deleted from the journal for an hour: its newest event is old", days=days)
        self._thread.start()
        return resumed

    @property
    def waiting(self) -> int:
        """Updates that wait to be written."""
        return self._put - self._taken - self._overflowed

    @property
    def used_bytes(self) -> int:
        """Size of the journal."""
        return self._journal.used_bytes

    def put(self, updates: Sequence[EventUpdate]) -> None:
        """Queue updates to be written and then published."""
        batch = _Batch(updates, self._clock.monotonic_ns(), deque(updates))
        self._put += len(updates)
        self._unpublished.append(batch)
        self._queue.put(batch)
        while self.waiting > WAITING_MAX:
            try:
                oldest = self._queue.get_nowait()
            except Empty:  # the thread has just taken it
                return
            if oldest is not None:
                self._overflowed += len(oldest.updates)
                self.failed[Reason.QUEUE_FULL] += len(oldest.updates)
                self._publish_all(oldest)

    @property
    def due_ns(self) -> float:
        """When `tick` has to publish if the disk does not answer; infinite: never."""
        return self._unpublished[0].put_ns + PUBLISH_AFTER_NS if self._unpublished else math.inf

    def tick(self, now_ns: int) -> None:
        """Publish what has waited too long for the disk."""
        while self._unpublished and (
            not self._unpublished[0].unpublished or now_ns - self._unpublished[0].put_ns > PUBLISH_AFTER_NS
        ):
            self.published_before_commit += self._publish_all(self._unpublished.popleft())

    def report_damage(self) -> None:
        """Have the whole file checked soon; any thread may call it."""
        self._is_damaged = True

    def close(self, timeout_s: float) -> None:
        """Write and publish what waits; what is not written within `timeout_s` is published at once."""
        self._queue.put(None)
        if self._thread.is_alive():
            self._thread.join(timeout_s)
        while self._unpublished:
            self.published_before_commit += self._publish_all(self._unpublished.popleft())

    def _publish_all(self, batch: _Batch) -> int:
        published = 0
        while batch.unpublished:
            try:
                update = batch.unpublished.popleft()
            except IndexError:  # the other thread has just taken it
                break
            self._publish(update)
            published += 1
        return published

    def _run(self) -> None:
        self._prune()
        try:
            while True:
                try:
                    batch = self._queue.get(timeout=_IDLE_S)
                except Empty:
                    self._prune()
                    self._mark(self._clock.monotonic_ns() - ON_BUS_AFTER_NS)
                else:
                    if batch is None:
                        break
                    self._take(batch)
                if self._clock.monotonic_ns() - self._checked_ns > CHECK_NS:
                    self._check()
            self._mark(self._clock.monotonic_ns())
        finally:
            self._journal.close()

    def _take(self, batch: _Batch) -> None:
        n = len(batch.updates)
        self._taken += n
        row = self._attempt(lambda: self._journal.write(batch.updates), n)
        if row is not None:
            self.written += n
        self._publish_all(batch)
        if row is not None:
            self._handed.append((row, self._clock.monotonic_ns()))
        self._prune_debt += n
        if self._prune_debt >= PRUNE_AT_ONCE // 2:
            self._prune()
            self._mark(self._clock.monotonic_ns() - ON_BUS_AFTER_NS)

    def _mark(self, until_ns: int) -> None:
        """Note in the journal what was handed to the bus before an instant."""
        row = 0
        while self._handed and self._handed[0][1] <= until_ns:
            row, _ = self._handed.popleft()
        if row:
            self._attempt(lambda: self._journal.mark_published(row), 0)

    def _check(self) -> None:
        """Find out whether the file is there and whole."""
        self._checked_ns = self._clock.monotonic_ns()
        if self._is_damaged:
            self._is_damaged = False
            self._attempt(self._journal.check_content, 0)
        if self._attempt(self._journal.check, 0) is False:
            self.replaced += 1
            _log.error("journal was deleted or replaced; a new one is begun")

    def _prune(self) -> None:
        """Prune up to twice as many updates as were written since the last time; all that are due when idle."""
        self._prune_debt = 0
        self._attempt(self._prune_step, 0)

    def _prune_step(self) -> None:
        """Prune by the earlier of two clocks, so that a clock that leaps ahead deletes nothing."""
        now_ns = self._clock.monotonic_ns()
        now_us = min(self._clock.wall_us(), self._clock.local_us())
        while pruned := self._journal.prune(now_us if now_ns >= self._ageing_ns else 0):
            self.pruned += pruned
            if not self._queue.empty():
                return

    def _attempt(self, task: Callable[[], _T], updates: int) -> _T | None:
        """Run the task; count a failure for so many updates, and log the first of a series."""
        trouble = result = None
        try:
            result = task()
        except (sqlite3.Error, OSError) as error:
            trouble = reason_of(error)
            self.failed[trouble] += updates
            self.replaced += trouble is Reason.CORRUPT
            if self.trouble is None:
                _log.error("journal fails; alerts are still published", reason=trouble, error=str(error))
        else:
            if self.trouble is not None:
                _log.info("journal works again")
        self.trouble = trouble
        return result
