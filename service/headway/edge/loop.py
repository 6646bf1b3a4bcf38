"""The loop. `iterate()` is the one place where time, bytes and sockets meet; it holds no rule of the domain."""

import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import structlog

from headway.core.types.batch import Batch
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import StepResult
from headway.edge.codec.decoded import Decoded
from headway.edge.codec.messages import DETAILS, Timing, encode, rejected_copy
from headway.edge.context import ServiceContext
from headway.edge.event_updates import EventUpdates
from headway.edge.handover import Handover
from headway.edge.storage.journal import EventUpdate, Resumed
from headway.edge.telemetry.latency import Iteration
from headway.edge.telemetry.reporter import Reporter
from headway.edge.transport.message import ReceivedMessage, Rejection, RejectReason
from headway.edge.transport.ports import Channel
from headway_schemas.keys import Keys

_log: Final = structlog.get_logger(__name__)
_WARMING: Final = np.uint8(Outcome.WARMING)
"""Outcomes above it are rejections. As a numpy number it compares ten times faster."""
_TICK_NS: Final = 20_000_000
"""Without messages the engine steps this often, because a miss begins at 0.6 s of silence. A site without a vehicle
has none."""
_IDLE_UNLESS_WAITING: Final = 64
"""With more messages than this waiting, the loop does not pause."""
_FEW: Final = 4
"""After this many messages or fewer the pause is longer, because an iteration costs most before its first message."""
_FEW_PAUSE_FACTOR: Final = 3
_WAIT_NS: Final = 250_000_000
"""Longest wait for a message."""
_COPIES_NS: Final = 1_000_000_000
"""`rejected_rate_hz` counts copies within this time."""
_SENDERS_BACK_NS: Final = 10_000_000_000
"""After the bus is back, senders reconnect within this time; if no message comes, there are none."""
_OPEN_NS: Final = 1_000_000_000
"""How often events are looked for that the detector has dropped, with their vehicle, and that still need an end."""
_COLLECT_IDLE_NS: Final = 10_000_000_000
_COLLECT_NS: Final = 60_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopConfig:
    """The loop's share of the settings."""

    batch_limit: int
    batch_bytes_limit: int
    idle_sleep_s: float
    rejected_rate_hz: float
    rejected_bytes_limit: int
    suspect_burst: int
    suspect_refill_s: float


class ServiceLoop:
    """Takes messages from the bus through the codec and the detector, and publishes the results."""

    def __init__(self, config: LoopConfig, context: ServiceContext, reporter: Reporter) -> None:
        self._config = config
        self._identity = context.identity
        self._keys = context.keys
        self._codec = context.codec
        self._engine = context.engine
        self._bus = context.bus
        self._clock = clock = context.clock
        self._health = context.health
        self._ledger = context.ledger
        self._latencies = context.latencies
        self._history = context.history
        self._persistence = context.persistence
        self._handover = context.handover
        self._reporter = reporter
        self._tick_ns = self._iteration_ns = self._collected_ns = self._copies_ns = clock.monotonic_ns()
        self._open_ns = self._tick_ns
        self._copies: Counter[Outcome] = Counter()
        self._event_updates = EventUpdates(
            context.identity, context.keys, context.history,
            burst=config.suspect_burst, refill_s=config.suspect_refill_s,
        )  # fmt: skip
        self._shed = 0
        self._until_us = 0
        """Local time until which every message has reached the engine."""
        self._reconnected_ns = 0
        self._absent_us: int | None = None
        """Unix time since which the service has not received; None: it receives."""

    def resume(self, resumed: Resumed) -> None:
        """Publish what the process before this one wrote and perhaps did not publish, and end what it left open."""
        self._event_updates.resume_after(resumed.sequence)
        for event in resumed.unpublished:
            update = self._event_updates.again(event)
            self._bus.publish(Channel.ALERT, update.key, update.payload)
        self._event_updates.adopt(resumed.open_events)
        known = self._engine.open_event_ids if resumed.open_events else set()
        self._end_dropped(now_ns=self._clock.monotonic_ns() + _OPEN_NS)
        if self._persistence is not None:
            self._absent_us = self._persistence.snapshots.newest_us or None
        if resumed.unpublished or resumed.open_events:
            continued = sum(event.event_id in known for event in resumed.open_events)
            _log.info(
                "events resumed", published_again=len(resumed.unpublished), continued=continued,
                ended=len(resumed.open_events) - continued,
            )  # fmt: skip

    def run(self, stopping: Callable[[], bool]) -> None:
        """Iterate until `stopping`; the garbage collector runs when no message waits."""
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            while not stopping():
                taken = self.iterate()
                self._collect(idle=not taken)
                self._idle(taken)
        finally:
            gc.enable()
            gc.unfreeze()

    def drain(self, timeout_s: float) -> int:
        """Unsubscribe, process what is queued, publish health; return how many messages are left."""
        self._bus.unsubscribe()
        until_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        while (
            self._event_updates.waiting or not (self._bus.delivered and self._bus.waiting == 0)
        ) and self._clock.monotonic_ns() < until_ns:
            self._idle(self.iterate())
        self._reporter.publish_health()
        return self._bus.waiting

    def iterate(self) -> int:
        """Process the messages that wait and do the periodic work that is due; return the number of messages."""
        now_ns = self._iteration_ns = self._clock.monotonic_ns()
        messages = self._bus.drain(self._config.batch_limit, self._config.batch_bytes_limit, now_ns)
        if messages or self._event_updates.waiting or now_ns >= self._tick_ns:
            self._tick_ns = now_ns + _TICK_NS
            self._detect(messages, now_ns)
        self._check_connection(now_ns)
        self._end_dropped(now_ns)
        self._reporter.tick(now_ns)
        if self._persistence is not None:
            self._persistence.tick(now_ns)
        return len(messages)

    def _check_connection(self, now_ns: int) -> None:
        health, connected = self._health, self._bus.connected
        if connected != health.connected:
            _log.info("connected" if connected else "disconnected", peers=self._bus.peers)
            self._reconnected_ns = now_ns
            if self._absent_us is None and not connected:
                self._absent_us = self._until_us + self._clock.wall_us() - self._clock.local_us()
        health.connected, health.subscribed, health.last_iteration_ns = connected, self._bus.subscribed, now_ns

    def _detect(self, messages: list[ReceivedMessage], drained_ns: int) -> None:
        drained_us = self._clock.local_us()
        clock_offset_us = self._clock.wall_us() - drained_us
        decoded = self._codec.decode(messages, clock_offset_us)
        self._history.add(messages, decoded, clock_offset_us)
        decoded_ns = self._clock.monotonic_ns()
        until_us = self._received_until_us(messages, drained_us)
        if self._handover is None:
            result = self._engine.step(decoded.batch, until_us, clock_offset_us)
        else:
            result = self._step_with_neighbours(self._handover, decoded.batch, until_us, clock_offset_us)
        detected_ns = self._clock.monotonic_ns()
        for failure in result.failures:
            _log.error("detector failed; these vehicles start again", error=failure.error, records=failure.records)
        decode_us, detect_us = (decoded_ns - drained_ns) / 1e3, (detected_ns - decoded_ns) / 1e3
        timing = Timing(drained_us, clock_offset_us, int(decode_us), int(detect_us))
        self._publish(self._event_updates.of(result.events, drained_ns, timing))
        self._publish_rejections(decoded, messages, result, drained_ns)
        self._ledger.record(len(messages), decoded.rejections, result, self._bus.shed_records)
        publish_us = (self._clock.monotonic_ns() - detected_ns) / 1e3
        self._latencies.record(
            Iteration(
                decoded.batch.received_us,
                decoded.batch.t_us,
                drained_us,
                clock_offset_us,
                decode_us,
                detect_us,
                publish_us,
            )
        )

    def _step_with_neighbours(
        self, handover: Handover, batch: Batch, until_us: int, clock_offset_us: int
    ) -> StepResult:
        """Take up vehicles from other sites, send those that go to one, and step."""
        for key, payload in self._bus.handovers():
            handover.receive(key.split("/")[-2], payload, until_us, clock_offset_us)
        handed = handover.before_step(batch, until_us, clock_offset_us)
        for site, vehicle, payload in handed.states:
            key = Keys(self._keys.prefix, site).handover(self._identity.site, vehicle)
            self._bus.publish(Channel.HANDOVER, key, payload)
        self._publish(self._event_updates.release(handed.event_ids, self._iteration_ns))
        return handover.engine.step(batch, until_us, clock_offset_us, owned=handed.owned)

    def _received_until_us(self, messages: list[ReceivedMessage], drained_us: int) -> int:
        """Return the time until which every message has reached the engine, which is its time for silence.

        While messages wait it is the receive time of the last one processed, so that no vehicle counts as silent
        whose messages still wait here or were shed. It stands still from the loss of the bus until senders are back.
        """
        if self._absent_us is not None:
            waited_ns = self._iteration_ns - self._reconnected_ns
            if messages or (self._health.connected and waited_ns > _SENDERS_BACK_NS):
                self._end_absence(drained_us)
            elif self._until_us:
                return self._until_us
        until_us = self._until_us = messages[-1].received_us if messages and self._bus.waiting else drained_us
        if self._bus.shed != self._shed:
            self._shed = self._bus.shed
            self._engine.ignore_gaps_before(until_us)
        return until_us

    def _end_absence(self, now_us: int) -> None:
        """Tell the span in which messages were sent and could not be received; no vehicle was silent in it."""
        assert self._absent_us is not None
        end_us = now_us + self._clock.wall_us() - self._clock.local_us()
        seconds = max(0.0, (end_us - self._absent_us) / 1e6)
        self._ledger.absent_s += seconds
        _log.warning(
            "what was sent in this time was not received", from_us=self._absent_us, to_us=end_us, seconds=seconds
        )
        self._absent_us = None
        self._engine.absent_until(now_us)

    def _end_dropped(self, now_ns: int) -> None:
        """Publish the end of events that the detector dropped without one, such as those of evicted vehicles."""
        if now_ns - self._open_ns < _OPEN_NS:
            return
        self._open_ns = now_ns
        if self._event_updates.has_open:
            self._publish(self._event_updates.end_others(self._engine.open_event_ids, self._clock.wall_us()))

    def _publish(self, updates: list[EventUpdate]) -> None:
        """Publish event updates; with persistence only after the journal has committed them."""
        if self._persistence is not None and updates:
            self._persistence.put(updates)
            return
        for update in updates:
            self._bus.publish(Channel.ALERT, update.key, update.payload)

    def _publish_rejections(
        self, decoded: Decoded, messages: list[ReceivedMessage], result: StepResult, now_ns: int
    ) -> None:
        if not self._bus.wanted(Channel.REJECTED):
            return
        by_core = np.flatnonzero(result.outcomes > _WARMING)
        if not (decoded.rejections or by_core.size):
            return
        if now_ns - self._copies_ns >= _COPIES_NS:
            self._copies_ns = now_ns
            self._copies.clear()
        for rejection in decoded.rejections:
            self._publish_rejection(rejection)
        for i in by_core:
            reason = Outcome(result.outcomes[i])
            self._publish_rejection(Rejection(RejectReason(reason, DETAILS[reason]), messages[decoded.sources[i]]))

    def _publish_rejection(self, rejection: Rejection) -> None:
        reason = rejection.reason.outcome
        if self._copies[reason] >= self._config.rejected_rate_hz:
            self._ledger.copies_withheld += 1
            return
        self._copies[reason] += 1
        copy = rejected_copy(rejection, payload_max_bytes=self._config.rejected_bytes_limit)
        self._bus.publish(Channel.REJECTED, self._keys.rejected(reason.label), encode(copy))

    def _idle(self, taken: int) -> None:
        """Pause so that a batch gathers, or wait for the first message; not behind a backlog.

        After a long iteration the pause is shorter, because its batch was large enough.
        """
        if self._bus.waiting > max(taken, _IDLE_UNLESS_WAITING) or self._event_updates.waiting:
            return
        now_ns, pause_s = self._clock.monotonic_ns(), self._config.idle_sleep_s
        if not taken:
            self._bus.wait(max(pause_s, (self._due_ns(now_ns) - now_ns) / 1e9))
            return
        if taken <= _FEW:
            pause_s *= _FEW_PAUSE_FACTOR
        self._clock.sleep(pause_s * pause_s / max(pause_s, (now_ns - self._iteration_ns) / 1e9))

    def _due_ns(self, now_ns: int) -> float:
        """Return until when there is nothing to do but to wait."""
        due_ns = min(now_ns + _WAIT_NS, self._reporter.due_ns)
        if self._engine.vehicles:
            due_ns = min(due_ns, self._tick_ns)
        return due_ns if self._persistence is None else min(due_ns, self._persistence.due_ns)

    def _collect(self, *, idle: bool) -> None:
        now_ns = self._clock.monotonic_ns()
        if now_ns - self._collected_ns >= (_COLLECT_IDLE_NS if idle else _COLLECT_NS):
            self._collected_ns = now_ns
            gc.collect()
