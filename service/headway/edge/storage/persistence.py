"""All that outlives the process, in one folder: the journal of events and the snapshot of the detector."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from headway.core.engine import Engine
from headway.edge.clock import Clock
from headway.edge.identity import Identity
from headway.edge.storage.journal import Journal, Statement
from headway.edge.storage.journal_query import History
from headway.edge.storage.journal_writer import Scribe
from headway.edge.storage.snapshots import Snapshots
from headway.edge.transport.ports import Query

JOURNAL_FILE: Final = "journal.sqlite"
"""Its name in the folder; instances on one machine may share it."""
_CLOSE_S: Final = 5.0


@dataclass(frozen=True, slots=True, kw_only=True)
class KeeperConfig:
    """Where, how long, how much, how often."""

    folder: Path
    journal_days: float
    journal_mb: float
    snapshot_interval_s: float


class Keeper:
    """Nothing here blocks the loop or raises, however the disk fares.

    Parameters
    ----------
    tell
        Tells one statement, once it is written down; any thread may call it.
    """

    def __init__(
        self, config: KeeperConfig, identity: Identity, engine: Engine, clock: Clock, tell: Callable[[Statement], None]
    ) -> None:
        journal = config.folder / JOURNAL_FILE
        snapshot = config.folder / f"{identity.site}-{identity.instance}.snapshot"
        self.scribe = Scribe(Journal(journal, days=config.journal_days, megabytes=config.journal_mb), tell, clock)
        self.snapshots = Snapshots(snapshot, config.snapshot_interval_s, engine, identity, clock)
        self._history = History(journal, identity.site)

    @property
    def troubles(self) -> tuple[str, ...]:
        """What does not work, a line each."""
        of = {"journal": self.scribe.trouble, "snapshot": self.snapshots.trouble}
        return tuple(f"{name}: {trouble}" for name, trouble in of.items() if trouble is not None)

    def put(self, statements: Sequence[Statement]) -> None:
        """Have these written down and told soon."""
        self.scribe.put(statements)

    def ask(self, query: Query) -> None:
        """Have a question for the history of events answered soon."""
        self._history.ask(query)

    def turn(self, now_ns: int) -> None:
        """Do what is due, a little of it."""
        self.scribe.turn(now_ns)
        self.snapshots.turn(now_ns)

    def close(self) -> None:
        """Write what waits, tell it, and take a last snapshot."""
        self.scribe.close(_CLOSE_S)
        self._history.close()
        self.snapshots.close()
