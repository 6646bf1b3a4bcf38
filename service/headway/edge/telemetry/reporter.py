"""What the service tells without being asked by a message: states, health, answers. A little in each turn."""

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from headway.core.engine import Engine
from headway.edge.clock import Clock
from headway.edge.codec.messages import encode, state_messages
from headway.edge.identity import Identity
from headway.edge.storage.persistence import Keeper
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import Vitals
from headway.edge.telemetry.latency import Latencies
from headway.edge.telemetry.process import rss_mb
from headway.edge.transport.ports import Bus, Channel, Query
from headway_schemas import Health
from headway_schemas.encodings import PAIR_STATES_JSON
from headway_schemas.keys import Keys

_SLICES: Final = 64
"""Vehicles are told of, and counted out to whoever asks, a 64th at a time."""
_DONE: Final = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportConfig:
    """How often, and the limits that go into a report."""

    state_rate_hz: float
    state_budget_hz: float
    health_interval_s: float
    vehicle_capacity: int
    queue_limit: int


class Reporter:
    """Tells the state of every vehicle in rotation, own health at an interval, and answers questions."""

    def __init__(
        self,
        *,
        config: ReportConfig,
        identity: Identity,
        keys: Keys,
        engine: Engine,
        bus: Bus,
        clock: Clock,
        vitals: Vitals,
        ledger: Ledger,
        latencies: Latencies,
        keeper: Keeper | None = None,
    ) -> None:
        self._config = config
        self._identity = identity
        self._keys = keys
        self._engine = engine
        self._bus = bus
        self._clock = clock
        self._vitals = vitals
        self._ledger = ledger
        self._latencies = latencies
        self._keeper = keeper
        self._state_ns = self._health_ns = clock.monotonic_ns()
        self._slice = 0
        self._answers: deque[Iterator[None]] = deque()

    def turn(self, now_ns: int) -> None:
        """Do what is due, at most one slice of each."""
        if now_ns >= self._health_ns:
            self._health_ns = now_ns + int(self._config.health_interval_s * 1e9)
            self.tell_health()
        if now_ns >= self._state_ns:
            self._state_ns = now_ns + self._slice_interval_ns()
            self._tell_slice()
        self._answer()

    def tell_health(self) -> None:
        """Tell own health, now."""
        self._bus.publish(Channel.HEALTH, self._keys.health(self._identity.instance), encode(self._health()))

    def _slice_interval_ns(self) -> int:
        per_slice_s = 1.0 / (_SLICES * self._config.state_rate_hz) if self._config.state_rate_hz else 1.0
        affordable_s = self._engine.vehicles / _SLICES / self._config.state_budget_hz
        return int(max(per_slice_s, affordable_s) * 1e9)

    def _tell_slice(self) -> None:
        if not (self._config.state_rate_hz and self._bus.wanted(Channel.STATE)):
            return
        self._slice = (self._slice + 1) % _SLICES
        for state in state_messages(self._engine.states(_SLICES, self._slice), self._identity.site):
            self._bus.publish(Channel.STATE, self._keys.pair_state(state.follower), encode(state))

    def _answer(self) -> None:
        query = self._bus.next_query()
        if query is not None and query.key == self._keys.alerts and self._keeper is not None:
            self._keeper.ask(query)
        elif query is not None:
            self._answers.append(self._answer_pairs(query))
        if self._answers and next(self._answers[0], _DONE) is _DONE:
            self._answers.popleft()

    def _answer_pairs(self, query: Query) -> Iterator[None]:
        """Answer with an array of the state of every vehicle, gathered over as many turns as there are slices."""
        told: list[bytes] = []
        for part in range(_SLICES):
            told += map(encode, state_messages(self._engine.states(_SLICES, part), self._identity.site))
            yield
        query.answer(b"[" + b",".join(told) + b"]", PAIR_STATES_JSON)

    def _health(self) -> Health:
        identity, ledger = self._identity, self._ledger
        return Health(
            instance=identity.instance,
            site=identity.site,
            t_us=self._clock.wall_us(),
            version=identity.version,
            model=identity.model,
            config_hash=identity.config_hash,
            ready=self._vitals.ready,
            uptime_s=self._vitals.uptime_s,
            vehicles=self._engine.vehicles,
            pairs=self._engine.pairs,
            capacity=self._config.vehicle_capacity,
            queue_depth=self._bus.waiting,
            queue_limit=self._config.queue_limit,
            scored=ledger.scored,
            warming=ledger.warming,
            rejected=ledger.rejected,
            lost=ledger.lost,
            events=sum(ledger.events.values()),
            latency_ms=dict(self._latencies.percentiles_ms()),
            missed=ledger.missed_messages,
            histograms_us=self._latencies.cumulative_us(),
            cpu_s=time.process_time(),
            rss_mb=rss_mb(),
            troubles=self._keeper.troubles if self._keeper is not None else (),
        )
