"""A service loop with all that it uses: a fake clock, a bus in memory, and any detector."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sim.clock import FakeClock
from sim.memory_bus import MemoryBus

from headway.edge.codec.decoder import Codec
from headway.edge.context import ServiceContext
from headway.edge.identity import Identity
from headway.edge.loop import LoopConfig, ServiceLoop
from headway.edge.message_history import MessageHistory
from headway.edge.storage.persistence import Persistence, PersistenceConfig
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import HealthState
from headway.edge.telemetry.latency import Latencies
from headway.edge.telemetry.reporter import ReportConfig, Reporter
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import ReceiveQueue
from headway_schemas import Keys

KEYS = Keys("v2x", "s")
IDENTITY = Identity(site="s", instance="i", version="1", model="aekf", config_hash="c0ffee")


@dataclass
class Rig:
    """A service loop with all that it uses."""

    engine: Any
    batch_limit: int = 1_000
    queue_limit: int = 10_000
    queue_age_limit_s: float = 1.0
    state_rate_hz: float = 0.0
    state_budget_hz: float = 1_000.0
    rejected_rate_hz: float = 3.0
    state_dir: Path | None = None
    identity: Identity = IDENTITY
    clock: FakeClock = field(default_factory=FakeClock)

    def __post_init__(self) -> None:
        self.health = HealthState(self.clock, warm=True)
        self.ledger, self.latencies = Ledger(), Latencies()
        self.codec = Codec(KEYS)
        self.bus = MemoryBus(
            ReceiveQueue(self.queue_limit, 1 << 30, round(self.queue_age_limit_s * 1e9), self.codec.records_in, 10**9),
            self.clock,
        )
        self.persistence = self._persistence(self.state_dir) if self.state_dir else None
        self.context = ServiceContext(
            identity=self.identity,
            keys=KEYS,
            clock=self.clock,
            codec=self.codec,
            engine=self.engine,
            bus=self.bus,
            health=self.health,
            ledger=self.ledger,
            latencies=self.latencies,
            history=MessageHistory(1 << 20, 8_192),
            vehicle_capacity=100,
            queue_limit=self.queue_limit,
            alarm_budget_per_hour=0.5,
            persistence=self.persistence,
        )
        reports = ReportConfig(
            state_rate_hz=self.state_rate_hz, state_budget_hz=self.state_budget_hz, health_interval_s=1.0
        )
        config = LoopConfig(
            batch_limit=self.batch_limit,
            batch_bytes_limit=1 << 20,
            idle_sleep_s=0.0005,
            rejected_rate_hz=self.rejected_rate_hz,
            rejected_bytes_limit=8,
            suspect_burst=1_000,
            suspect_refill_s=600.0,
        )
        self.loop = ServiceLoop(config, self.context, Reporter(reports, self.context))
        if self.persistence is not None:
            self.loop.resume(self.persistence.start())

    def _persistence(self, folder: Path) -> Persistence:
        config = PersistenceConfig(
            folder=folder, snapshot_folder=folder, journal_days=1.0, journal_mb=100.0, snapshot_interval_s=5.0
        )
        publish = lambda update: self.bus.publish(Channel.ALERT, update.key, update.payload)  # noqa: E731
        return Persistence(config, self.identity, self.engine, self.clock, publish)

    def iterate(self, seconds: float, step_s: float = 0.001) -> None:
        """Iterate for so long, on the fake clock."""
        until_ns = self.clock.monotonic_ns() + round(seconds * 1e9)
        while self.clock.monotonic_ns() < until_ns:
            self.loop.iterate()
            self.clock.sleep(step_s)
