"""What the parts of one running service share."""

from dataclasses import dataclass

from headway.core.engine import Engine
from headway.edge.cells.cell_engines import CellEngines
from headway.edge.clock import Clock
from headway.edge.codec.decoder import Codec
from headway.edge.handover import Handover
from headway.edge.identity import Identity
from headway.edge.message_history import MessageHistory
from headway.edge.storage.persistence import Persistence
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import HealthState
from headway.edge.telemetry.latency import Latencies
from headway.edge.transport.ports import Bus
from headway_schemas.keys import Keys


@dataclass(frozen=True, slots=True, kw_only=True)
class ServiceContext:
    """Built once at the start and handed to the loop, the reporter and the metrics."""

    identity: Identity
    keys: Keys
    clock: Clock
    codec: Codec
    engine: Engine | CellEngines
    bus: Bus
    health: HealthState
    ledger: Ledger
    latencies: Latencies
    history: MessageHistory
    vehicle_capacity: int
    queue_limit: int
    alarm_budget_per_hour: float
    persistence: Persistence | None = None
    """None: neither journal nor snapshot."""
    handover: Handover | None = None
    """None: no vehicle goes to another site, or comes from one."""
