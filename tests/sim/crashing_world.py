"""A world whose disk fails and whose process is killed, at moments from the seed; what is left is found by the next.

Threads of the journal and of the snapshots have ended their work after each iteration, so a run is the same each time.
"""

import math
import sqlite3
import threading
from collections import Counter
from pathlib import Path
from typing import Any

from sim.rig import Rig
from sim.until import until
from sim.world import ITERATION_S, SimWorld

from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.core.types.outcome import Outcome
from headway.edge.storage import journal_writer, snapshots
from headway.edge.storage.journal import Journal
from headway.edge.transport.ports import Channel

DETECTOR = DetectorConfig(vehicle_capacity=32)
FAULT_EVERY, FAULT_LASTS, FAULT_MPS = 50, 15, 3.0
DOWN_S = (0.5, 3.0)
DISK_FULL = sqlite3.OperationalError("database or disk is full")
DISK_FULL.sqlite_errorcode = sqlite3.SQLITE_FULL


class CrashingWorld(SimWorld):
    """Each second vehicle has a faulty speed for 1.5 s, every five seconds.

    Crashes and faults of the disk are so many each second. Each `fatal_end`-th end of an event is committed and never
    published, because the process is killed between the two.
    """

    def __init__(
        self,
        seed: int,
        folder: Path,
        monkeypatch: Any,
        *,
        crashes: float = 0.0,
        disk_faults: float = 0.0,
        fatal_end: float = math.inf,
    ) -> None:
        super().__init__(seed, detector=DETECTOR, garbled=0.0, doubled=0.0)
        self._folder, self._crash_rate, self._fault_rate = folder, crashes * ITERATION_S, disk_faults * ITERATION_S
        self._disk_fails_s, self._fatal_end, self._ends, self._is_dead = 0.0, fatal_end, 0, False
        self.crashes = self.torn = self.unheard = 0
        """Processes killed, parts of a snapshot torn, and records that no process received."""
        self.outcomes: Counter[Outcome] = Counter()
        """Of the processes that have ended."""
        self.alerts: list[dict[str, Any]] = []
        """Of all processes."""
        monkeypatch.setattr(journal_writer, "_IDLE_S", 3_600.0)  # of real time, in which its thread does more
        write, overwrite = Journal.write, snapshots._overwrite

        def write_or_fail(journal: Journal, updates: Any) -> int:
            if self._disk_fails_s > 0.0:
                raise DISK_FULL
            return write(journal, updates)

        def overwrite_or_fail(*arguments: Any, **options: Any) -> None:
            if self._disk_fails_s > 0.0:
                raise OSError(28, "No space left on device")
            overwrite(*arguments, **options)

        monkeypatch.setattr(Journal, "write", write_or_fail)
        monkeypatch.setattr(snapshots, "_overwrite", overwrite_or_fail)
        self._start()

    def iterate(self) -> None:
        """Iterate, let the threads end their work, and let disk and process fail as often as they do."""
        self._disk_fails_s -= ITERATION_S
        if self._rng.random() < self._fault_rate:
            self._disk_fails_s = self._rng.uniform(0.5, 3.0)
        is_last = self._rng.random() < self._crash_rate
        if is_last and self._rng.random() < 0.5:
            self._is_dead = True  # killed after the commit of what this iteration finds
        self.rig.loop.iterate()
        self._settle()
        if is_last or self._is_dead:
            self._crash()

    def stop(self, after_s: float) -> None:
        """Let time pass without vehicles, then drain and close, as after SIGTERM; nothing fails from now on."""
        self._disk_fails_s, self._fatal_end = 0.0, math.inf
        for _ in range(round(after_s / 0.1)):
            self.rig.clock.sleep(0.1)
            self.rig.loop.iterate()
        self.rig.loop.drain(1.0)
        self.rig.persistence.close()
        self._note()

    def _record(self, vehicle: int, k: int, at_s: float) -> list[Any]:
        record = super()._record(vehicle, k, at_s)
        if vehicle % 2 and k % FAULT_EVERY >= FAULT_EVERY - FAULT_LASTS:
            record[6] += FAULT_MPS
        return record

    def _start(self) -> None:
        self._is_dead = False
        self.rig = Rig(Engine(DETECTOR), state_dir=self._folder, clock=self.rig.clock, queue_limit=100_000)
        publish = self.rig.bus.publish

        def publish_unless_dead(channel: Channel, key: str, payload: bytes) -> None:
            if channel is Channel.ALERT and b'"phase":"cleared"' in payload:
                self._ends += 1
                self._is_dead |= self._ends % self._fatal_end == 0
            if not self._is_dead:
                publish(channel, key, payload)

        self.rig.bus.publish = publish_unless_dead
        self._settle()

    def _settle(self) -> None:
        """Wait until the threads have done what the loop gave them."""
        writer, done = self.rig.persistence.journal_writer, threading.Event()
        until(lambda: writer.waiting == 0 and not any(batch.unpublished for batch in list(writer._unpublished)))
        self.rig.persistence.snapshots._worker.put(done.set)
        done.wait()
        writer._mark(self.rig.clock.monotonic_ns() - journal_writer.ON_BUS_AFTER_NS)  # as its thread does when idle

    def _crash(self) -> None:
        """Kill the process, perhaps while it writes a part of the snapshot, and start another a while later."""
        self.crashes += 1
        self._note()
        persistence = self.rig.persistence
        persistence.journal_writer._mark = lambda _until_ns: None
        persistence.journal_writer.close(5.0)
        persistence.snapshots._worker.close(5.0)
        persistence._held.close()
        parts = sorted(self._folder.glob("*.snapshot/*.part"))
        if parts and self._rng.random() < 0.5:
            part = parts[int(self._rng.integers(len(parts)))]
            part.write_bytes(part.read_bytes()[: int(self._rng.integers(part.stat().st_size + 1))])
            self.torn += 1
        self.rig.clock.sleep(self._rng.uniform(*DOWN_S))
        self.unheard += sum(records for _, records, _ in self.due())
        self._start()

    def _note(self) -> None:
        self.outcomes.update({outcome: self.rig.ledger[outcome] for outcome in Outcome})
        self.alerts += self.published(Channel.ALERT)
