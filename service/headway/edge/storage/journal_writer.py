"""Statements are written down, then told: by a thread of its own, for a commit may take as long as the disk likes."""

import sqlite3
import threading
from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Final

import structlog

from headway.edge.clock import Clock
from headway.edge.storage.journal import PRUNE_AT_ONCE, Journal, Reason, Statement, reason_of

WAITING_MAX: Final = 2_000
"""Statements that wait for the disk: some 20 MB."""
PATIENCE_NS: Final = 1_000_000_000
"""What has not been written by then is told before it is."""
_IDLE_S: Final = 1.0
"""After so long without a statement there is time to prune."""

_log: Final = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class _Batch:
    """The statements of one turn. Whoever takes one out of `untold` tells it, so that it is told once."""

    statements: Sequence[Statement]
    put_ns: int
    untold: deque[Statement] = field(default_factory=deque)


class Scribe:
    """Keeps each turn's statements in one transaction and then tells them, in their order.

    `put` and `turn` belong to the loop; neither ever waits. Where the disk fails, the statements are told without, and
    counted under the reason; where it does not answer, they are told after a second and written when it does.

    Parameters
    ----------
    journal
        Where to write.
    tell
        Tells one statement; any thread may call it.
    """

    def __init__(self, journal: Journal, tell: Callable[[Statement], None], clock: Clock) -> None:
        self._journal = journal
        self._tell = tell
        self._clock = clock
        self._queue: SimpleQueue[_Batch | None] = SimpleQueue()
        self._untold: deque[_Batch] = deque()
        self._put = self._taken = self._displaced = self._owed = 0
        self.written = 0
        """Statements in the journal."""
        self.failed: Counter[Reason] = Counter(dict.fromkeys(Reason, 0))
        """Statements that are not, by reason."""
        self.hurried = 0
        """Statements told before they were written."""
        self.pruned = 0
        self.trouble: Reason | None = None
        """Why the newest attempt failed; None: it did not."""
        self._thread = threading.Thread(target=self._run, name="headway-journal", daemon=True)
        self._thread.start()

    @property
    def waiting(self) -> int:
        """Statements that wait to be written."""
        return self._put - self._taken - self._displaced

    @property
    def used_bytes(self) -> int:
        """What the journal holds."""
        return self._journal.used_bytes

    def put(self, statements: Sequence[Statement]) -> None:
        """Have these written and told soon."""
        batch = _Batch(statements, self._clock.monotonic_ns(), deque(statements))
        self._put += len(statements)
        self._untold.append(batch)
        self._queue.put(batch)
        while self.waiting > WAITING_MAX:
            try:
                oldest = self._queue.get_nowait()
            except Empty:  # the thread has just taken it
                return
            if oldest is not None:
                self._displaced += len(oldest.statements)
                self.failed[Reason.QUEUE_FULL] += len(oldest.statements)
                self._tell_all(oldest)

    def turn(self, now_ns: int) -> None:
        """Tell what has waited too long for the disk."""
        while self._untold and (not self._untold[0].untold or now_ns - self._untold[0].put_ns > PATIENCE_NS):
            self.hurried += self._tell_all(self._untold.popleft())

    def close(self, timeout_s: float) -> None:
        """Write and tell what waits; what is not written in time is told at once."""
        self._queue.put(None)
        self._thread.join(timeout_s)
        while self._untold:
            self.hurried += self._tell_all(self._untold.popleft())

    def _tell_all(self, batch: _Batch) -> int:
        told = 0
        while batch.untold:
            try:
                statement = batch.untold.popleft()
            except IndexError:  # the other thread has just taken it
                break
            self._tell(statement)
            told += 1
        return told

    def _run(self) -> None:
        self._prune()
        try:
            while True:
                try:
                    batch = self._queue.get(timeout=_IDLE_S)
                except Empty:
                    self._prune()
                    continue
                if batch is None:
                    return
                self._take(batch)
        finally:
            self._journal.close()

    def _take(self, batch: _Batch) -> None:
        n = len(batch.statements)
        self._taken += n
        if self._attempt(lambda: self._journal.write(batch.statements), n):
            self.written += n
        self._tell_all(batch)
        self._owed += n
        if self._owed >= PRUNE_AT_ONCE // 2:
            self._prune()

    def _prune(self) -> None:
        """Take away up to twice what has come since the last time; when idle, all that is due."""
        self._owed = 0
        self._attempt(self._prune_step, 0)

    def _prune_step(self) -> None:
        while pruned := self._journal.prune(self._clock.wall_us()):
            self.pruned += pruned
            if not self._queue.empty():
                return

    def _attempt(self, act: Callable[[], None], statements: int) -> bool:
        """Do it; a failure is counted for so many statements, and logged where it is news."""
        trouble = None
        try:
            act()
        except (sqlite3.Error, OSError) as error:
            trouble = reason_of(error)
            self.failed[trouble] += statements
            if self.trouble is None:
                _log.error("journal fails; alerts go out all the same", reason=trouble, error=str(error))
        else:
            if self.trouble is not None:
                _log.info("journal works again")
        self.trouble = trouble
        return trouble is None
