"""What the service publishes on a timer or on a query: states, health, answers. Each loop iteration does a part."""

import time
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from headway.edge.cells.cell_engines import CellEngines
from headway.edge.cells.engine_process import EngineFigures
from headway.edge.codec.messages import encode, quality_messages, state_messages
from headway.edge.context import ServiceContext
from headway.edge.telemetry.process import rss_mb
from headway.edge.transport.ports import Channel, Query
from headway_schemas import Health
from headway_schemas.encodings import PAIR_STATES_JSON

_SLICES: Final = 64
"""States are published, and queries for them answered, a 64th of the vehicles at a time."""
_QUALITY_INTERVAL_S: Final = 10.0
"""The quality of each vehicle's sensors, which changes within minutes, is published as often."""
_DONE: Final = object()


@dataclass(frozen=True, slots=True, kw_only=True)
class ReportConfig:
    """How often the service reports."""

    state_rate_hz: float
    state_budget_hz: float
    health_interval_s: float


class Reporter:
    """Publishes state and sensor quality of each vehicle in rotation, and health at an interval; answers queries."""

    def __init__(self, config: ReportConfig, context: ServiceContext) -> None:
        self._config = config
        self._context = context
        self._identity = context.identity
        self._keys = context.keys
        self._engine = context.engine
        self._bus = context.bus
        self._persistence = context.persistence
        self._state_ns = self._health_ns = context.clock.monotonic_ns()
        self._quality_ns = self._state_ns
        self._slice = self._quality_slice = 0
        self._answers: deque[Iterator[None]] = deque()

    def tick(self, now_ns: int) -> None:
        """Publish what is due, at most one slice of each."""
        if now_ns >= self._health_ns:
            self._health_ns = now_ns + int(self._config.health_interval_s * 1e9)
            self.publish_health()
        if now_ns >= self._state_ns:
            self._state_ns = now_ns + self._slice_interval_ns()
            self._publish_slice()
        if now_ns >= self._quality_ns:
            self._quality_ns = now_ns + int(_QUALITY_INTERVAL_S / _SLICES * 1e9)
            self._publish_quality()
        self._answer()

    @property
    def due_ns(self) -> int:
        """Monotonic time of the next report; 0: the next part of an answer."""
        if self._answers:
            return 0
        due_ns = self._health_ns
        if self._engine.vehicles and self._bus.wanted(Channel.STATE):
            due_ns = min(due_ns, self._state_ns)
        if self._engine.vehicles and self._bus.wanted(Channel.QUALITY):
            due_ns = min(due_ns, self._quality_ns)
        return due_ns

    def publish_health(self) -> None:
        """Publish health now."""
        self._bus.publish(Channel.HEALTH, self._keys.health(self._identity.instance), encode(self._health_message()))

    def _slice_interval_ns(self) -> int:
        per_slice_s = 1.0 / (_SLICES * self._config.state_rate_hz) if self._config.state_rate_hz else 1.0
        affordable_s = self._engine.vehicles / _SLICES / self._config.state_budget_hz
        return int(max(per_slice_s, affordable_s) * 1e9)

    def _publish_slice(self) -> None:
        if not (self._config.state_rate_hz and self._bus.wanted(Channel.STATE)):
            return
        self._slice = (self._slice + 1) % _SLICES
        for state in state_messages(self._engine.states(_SLICES, self._slice), self._identity.site):
            self._bus.publish(Channel.STATE, self._keys.pair_state(state.follower), encode(state))

    def _publish_quality(self) -> None:
        if not self._bus.wanted(Channel.QUALITY):
            return
        self._quality_slice = (self._quality_slice + 1) % _SLICES
        states = self._engine.qualities(_SLICES, self._quality_slice)
        if states is not None:
            for quality in quality_messages(states, self._identity.site):
                self._bus.publish(Channel.QUALITY, self._keys.quality(quality.vehicle), encode(quality))

    def _answer(self) -> None:
        while (query := self._bus.next_query()) is not None:
            if query.key == self._keys.alerts and self._persistence is not None:
                self._persistence.ask(query)
            elif query.key == self._keys.handling and self._persistence is not None:
                self._persistence.handle(query)
            else:
                self._answers.append(self._answer_pairs(query))
        if self._answers and next(self._answers[0], _DONE) is _DONE:
            self._answers.popleft()

    def _answer_pairs(self, query: Query) -> Iterator[None]:
        """Answer with an array of the state of each vehicle, gathered over one loop iteration for each slice."""
        states: list[bytes] = []
        for part in range(_SLICES):
            states += map(encode, state_messages(self._engine.states(_SLICES, part), self._identity.site))
            yield
        query.answer(b"[" + b",".join(states) + b"]", PAIR_STATES_JSON)

    def _health_message(self) -> Health:
        context, identity, ledger, own_mb = self._context, self._identity, self._context.ledger, rss_mb()
        return Health(
            instance=identity.instance,
            epoch=identity.epoch,
            site=identity.site,
            t_us=context.clock.wall_us(),
            version=identity.version,
            model=identity.model,
            config_hash=identity.config_hash,
            ready=context.health.ready,
            uptime_s=context.health.uptime_s,
            vehicles=self._engine.vehicles,
            pairs=self._engine.pairs,
            capacity=context.vehicle_capacity,
            queue_depth=self._bus.waiting,
            queue_limit=context.queue_limit,
            scored=ledger.scored,
            warming=ledger.warming,
            rejected=ledger.rejected,
            lost=ledger.lost,
            events=sum(ledger.events.values()),
            latency_ms=dict(context.latencies.percentiles_ms()),
            sequence_gap_messages=ledger.sequence_gap_messages,
            histograms_us=context.latencies.cumulative_us(),
            cpu_s=time.process_time() + sum(of.cpu_s for of in self._processes()),
            rss_mb=own_mb and own_mb + sum(of.rss_mb for of in self._processes()),
            troubles=self._troubles(),
        )

    def _processes(self) -> list[EngineFigures]:
        return self._engine.figures if isinstance(self._engine, CellEngines) else []

    def _troubles(self) -> tuple[str, ...]:
        stored = self._persistence.troubles if self._persistence is not None else ()
        return (*stored, *(f"site: {other} judges it too" for other in self._bus.other_services))
