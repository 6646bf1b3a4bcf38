"""What outlives the process: the journal of events, and the snapshot of the detector, which may be kept in memory."""

import fcntl
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from headway.core.engine import Engine
from headway.edge.cells.cell_engines import CellEngines, EngineSnapshots
from headway.edge.clock import Clock
from headway.edge.fence import Fence
from headway.edge.identity import Identity
from headway.edge.storage.handling_store import HandlingQueryable
from headway.edge.storage.journal import EventUpdate, Journal, Resumed
from headway.edge.storage.journal_query import HistoryQueryable
from headway.edge.storage.journal_writer import JournalWriter
from headway.edge.storage.snapshots import Snapshots
from headway.edge.transport.ports import Query
from headway.errors import UserError
from headway_schemas.handling import Handling

JOURNAL_FILE: Final = "journal.sqlite"
"""File in the folder; instances on one machine may share it."""
_CLOSE_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class PersistenceConfig:
    """Where to store, for how long, how much, how often."""

    folder: Path
    snapshot_folder: Path
    journal_days: float
    journal_mb: float
    snapshot_interval_s: float


class Persistence:
    """Journal and snapshots. No method blocks the loop or raises, whatever the disk does.

    Parameters
    ----------
    publish
        Publishes one event update after its commit; any thread may call it.
    publish_handling
        Publishes how a person handles a vehicle; another thread calls it.
    fence
        Decides who uses the folder in a fleet; a process that hangs would keep a lock.
    """

    def __init__(
        self,
        config: PersistenceConfig,
        identity: Identity,
        engine: Engine | CellEngines,
        clock: Clock,
        publish: Callable[[EventUpdate], None],
        publish_handling: Callable[[Handling], None] = lambda _: None,
        fence: Fence | None = None,
    ) -> None:
        journal = config.folder / JOURNAL_FILE
        self._lock = config.folder / f"{identity.site}-{identity.instance}.lock"
        self._held = ExitStack()
        self._fence = fence
        self.journal_writer = JournalWriter(
            Journal(
                journal,
                site=identity.site,
                instance=identity.instance,
                days=config.journal_days,
                megabytes=config.journal_mb,
            ),
            publish,
            clock,
        )
        self.snapshots: Snapshots | EngineSnapshots
        if isinstance(engine, CellEngines):
            self.snapshots = EngineSnapshots(engine)
        else:
            folder = config.snapshot_folder / f"{identity.site}-{identity.instance}.snapshot"
            self.snapshots = Snapshots(folder, config.snapshot_interval_s, engine, identity, clock)
        self._history = HistoryQueryable(journal, identity.site, self.journal_writer.report_damage)
        self._handling = HandlingQueryable(journal, identity.site, clock, publish_handling)

    def start(self) -> Resumed:
        """Load the snapshot and start to write; return what the journal says of the process before this one.

        Raises `UserError` while another process of the same site and instance uses the folder, or has a higher epoch.
        """
        self._take_folder()
        self.snapshots.load()
        return self.journal_writer.start()

    def _take_folder(self) -> None:
        """Lock the folder for this site and instance; where it cannot be written, the journal tells so."""
        if self._fence is not None:
            self._fence.claim()
            return
        try:
            self._lock.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
            file = self._held.enter_context(self._lock.open("w"))
        except OSError:
            return
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._held.close()
            raise UserError(
                f"state_dir {self._lock.parent}: another service of this site and instance uses it; set instance"
            ) from None

    @property
    def troubles(self) -> tuple[str, ...]:
        """Problems, a line each."""
        of = {"journal": self.journal_writer.trouble, "snapshot": self.snapshots.trouble}
        return tuple(f"{name}: {trouble}" for name, trouble in of.items() if trouble is not None)

    def put(self, updates: Sequence[EventUpdate]) -> None:
        """Queue updates to be written and then published."""
        self.journal_writer.put(updates)

    def ask(self, query: Query) -> None:
        """Queue a query for the history of events."""
        self._history.ask(query)

    def handle(self, query: Query) -> None:
        """Queue a request to handle a vehicle, or a query for how vehicles are handled."""
        self._handling.ask(query)

    @property
    def due_ns(self) -> float:
        """Monotonic time of the next work; infinite: none is due."""
        return min(self.journal_writer.due_ns, self.snapshots.due_ns)

    def tick(self, now_ns: int) -> None:
        """Do a part of the work that is due."""
        self.journal_writer.tick(now_ns)
        self.snapshots.tick(now_ns)

    def close(self) -> None:
        """Write and publish what waits, then take a last snapshot."""
        self.journal_writer.close(_CLOSE_S)
        self._history.close()
        self._handling.close()
        # The service that waits for this one reads what the system has, and need not wait for the disk.
        self.snapshots.close(sync=self._fence is None or not self._fence.is_replaced)
        self._held.close()
