"""A shell with all that it touches: a fake clock, a bus in memory, and any detector."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sim.clock import FakeClock
from sim.memory_bus import MemoryBus

from headway.edge.codec.decoder import Codec
from headway.edge.identity import Identity
from headway.edge.loop import Shell, ShellConfig
from headway.edge.storage.persistence import Keeper, KeeperConfig
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import Vitals
from headway.edge.telemetry.latency import Latencies
from headway.edge.telemetry.reporter import ReportConfig, Reporter
from headway.edge.transport.ports import Channel
from headway.edge.transport.receive_queue import Inbox
from headway_schemas import Keys

KEYS = Keys("v2x", "s")
IDENTITY = Identity(site="s", instance="i", version="1", model="aekf", config_hash="c0ffee")


@dataclass
class Rig:
    """A shell with all that it touches."""

    engine: Any
    batch_limit: int = 1_000
    queue_limit: int = 10_000
    queue_age_limit_s: float = 1.0
    state_rate_hz: float = 0.0
    state_budget_hz: float = 1_000.0
    rejected_rate_hz: float = 3.0
    state_dir: Path | None = None
    identity: Identity = IDENTITY

    def __post_init__(self) -> None:
        self.clock = FakeClock()
        self.vitals = Vitals(self.clock, warm=True)
        self.ledger, self.latencies = Ledger(), Latencies()
        self.codec = Codec(KEYS)
        self.bus = MemoryBus(
            Inbox(self.queue_limit, 1 << 30, round(self.queue_age_limit_s * 1e9), self.codec.records_in)
        )
        self.keeper = self._keeper(self.state_dir) if self.state_dir else None
        shared = {
            "identity": self.identity,
            "keys": KEYS,
            "engine": self.engine,
            "bus": self.bus,
            "clock": self.clock,
            "vitals": self.vitals,
            "ledger": self.ledger,
            "latencies": self.latencies,
            "keeper": self.keeper,
        }
        reporter = Reporter(
            config=ReportConfig(
                state_rate_hz=self.state_rate_hz,
                state_budget_hz=self.state_budget_hz,
                health_interval_s=1.0,
                vehicle_capacity=100,
                queue_limit=self.queue_limit,
            ),
            **shared,
        )
        self.shell = Shell(
            config=ShellConfig(
                batch_limit=self.batch_limit,
                batch_bytes_limit=1 << 20,
                idle_sleep_s=0.0005,
                rejected_rate_hz=self.rejected_rate_hz,
                rejected_bytes_limit=8,
            ),
            codec=self.codec,
            reporter=reporter,
            **shared,
        )

    def _keeper(self, folder: Path) -> Keeper:
        config = KeeperConfig(folder=folder, journal_days=1.0, journal_mb=100.0, snapshot_interval_s=5.0)
        tell = lambda told: self.bus.publish(Channel.ALERT, told.key, told.payload)  # noqa: E731
        return Keeper(config, self.identity, self.engine, self.clock, tell)

    def turns(self, seconds: float, step_s: float = 0.001) -> None:
        """Turn for so long, on the fake clock."""
        until_ns = self.clock.monotonic_ns() + round(seconds * 1e9)
        while self.clock.monotonic_ns() < until_ns:
            self.shell.turn()
            self.clock.sleep(step_s)
