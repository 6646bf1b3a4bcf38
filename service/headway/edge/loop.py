"""The loop. `turn()` is the one place where time, bytes and sockets meet; no rule of the domain lives here."""

import gc
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
import structlog

from headway.core.engine import Engine
from headway.core.types.batch import F64
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import AnomalyEvent, StepResult
from headway.edge.clock import Clock
from headway.edge.codec.decoder import Codec, Decoded
from headway.edge.codec.messages import DETAILS, encode, event_message, rejected_copy
from headway.edge.identity import Identity
from headway.edge.storage.journal import Statement
from headway.edge.storage.persistence import Keeper
from headway.edge.telemetry.accounting import Ledger
from headway.edge.telemetry.health import Vitals
from headway.edge.telemetry.latency import Latencies
from headway.edge.telemetry.reporter import Reporter
from headway.edge.transport.message import Arrival, Fault, Rejection
from headway.edge.transport.ports import Bus, Channel
from headway_schemas.event import Stage
from headway_schemas.keys import Keys

_log: Final = structlog.get_logger(__name__)
_WARMING: Final = np.uint8(Outcome.WARMING)
"""Outcomes beyond it are rejections; as numpy's own number it is compared ten times faster."""
_TICK_NS: Final = 20_000_000
"""Without messages, time passes for the engine this often: silence is judged from 0.6 s on."""
_REST_UNLESS_WAITING: Final = 64
"""So many messages gather between turns before the loop goes without rest."""
_QUIET_NS: Final = 1_000_000_000
_QUIET_REST: Final = 10
"""After a second without any message the loop rests so many times longer."""
_COLLECT_IDLE_NS: Final = 10_000_000_000
_COLLECT_NS: Final = 60_000_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ShellConfig:
    """The loop's share of the settings."""

    batch_limit: int
    batch_bytes_limit: int
    idle_sleep_s: float
    rejected_rate_hz: float
    rejected_bytes_limit: int


class Shell:
    """Takes messages from the bus through the codec and the detector, and tells what comes of it."""

    def __init__(
        self,
        *,
        config: ShellConfig,
        identity: Identity,
        keys: Keys,
        codec: Codec,
        engine: Engine,
        bus: Bus,
        clock: Clock,
        vitals: Vitals,
        ledger: Ledger,
        latencies: Latencies,
        reporter: Reporter,
        keeper: Keeper | None = None,
    ) -> None:
        self._config = config
        self._identity = identity
        self._keys = keys
        self._codec = codec
        self._engine = engine
        self._bus = bus
        self._clock = clock
        self._vitals = vitals
        self._ledger = ledger
        self._latencies = latencies
        self._reporter = reporter
        self._keeper = keeper
        self._tick_ns = self._turned_ns = self._heard_ns = self._collected_ns = self._copies_ns = clock.monotonic_ns()
        self._copies: Counter[Outcome] = Counter()
        self._shed = 0

    def run(self, stopping: Callable[[], bool]) -> None:
        """Turn until `stopping`; the garbage collector works when there is nothing else to do."""
        gc.collect()
        gc.freeze()
        gc.disable()
        try:
            while not stopping():
                taken = self.turn()
                self._collect(idle=not taken)
                self._rest(taken)
        finally:
            gc.enable()
            gc.unfreeze()

    def drain(self, timeout_s: float) -> int:
        """Take nothing more in, judge what is queued, tell own health; return how many messages are left over."""
        self._bus.unsubscribe()
        until_ns = self._clock.monotonic_ns() + int(timeout_s * 1e9)
        while not (self._bus.delivered and self._bus.waiting == 0) and self._clock.monotonic_ns() < until_ns:
            self._rest(self.turn())
        self._reporter.tell_health()
        return self._bus.waiting

    def turn(self) -> int:
        """Take what has come, judge it, tell what comes of it; return how many messages that was."""
        now_ns = self._turned_ns = self._clock.monotonic_ns()
        arrivals = self._bus.drain(self._config.batch_limit, self._config.batch_bytes_limit, now_ns)
        if arrivals or now_ns >= self._tick_ns:
            self._tick_ns = now_ns + _TICK_NS
            self._judge(arrivals, now_ns)
        self._look(now_ns)
        self._reporter.turn(now_ns)
        if self._keeper is not None:
            self._keeper.turn(now_ns)
        return len(arrivals)

    def _look(self, now_ns: int) -> None:
        vitals, connected = self._vitals, self._bus.connected
        if connected != vitals.connected:
            _log.info("connected" if connected else "disconnected", transports=self._bus.transports)
        vitals.connected, vitals.subscribed, vitals.last_turn_ns = connected, self._bus.subscribed, now_ns

    def _judge(self, arrivals: list[Arrival], drained_ns: int) -> None:
        drained_us = self._clock.wall_us()
        decoded = self._codec.decode(arrivals)
        decoded_ns = self._clock.monotonic_ns()
        result = self._engine.step(decoded.batch, self._heard_until_us(arrivals, drained_us))
        detected_ns = self._clock.monotonic_ns()
        decode_us, detect_us = (decoded_ns - drained_ns) / 1e3, (detected_ns - decoded_ns) / 1e3
        self._tell_events(result.events, drained_us, int(decode_us), int(detect_us))
        self._tell_rejections(decoded, arrivals, result, drained_ns)
        self._ledger.book(len(arrivals), decoded.rejections, result, self._bus.shed_records)
        publish_us = (self._clock.monotonic_ns() - detected_ns) / 1e3
        ages_us: F64 = (drained_us + decode_us + detect_us) - decoded.batch.t_us.astype(np.float64)
        self._latencies.book(_waits_us(decoded, arrivals, drained_ns), ages_us, decode_us, detect_us, publish_us)

    def _heard_until_us(self, arrivals: list[Arrival], drained_us: int) -> int:
        """Return the time that the detector may take for now: with messages still waiting, when the last was received.

        Nobody is accused of the silence of messages that lie here or were shed.
        """
        until_us = arrivals[-1].received_us if arrivals and self._bus.waiting else drained_us
        if self._bus.shed != self._shed:
            self._shed = self._bus.shed
            self._engine.ignore_gaps_before(until_us)
        return until_us

    def _tell_events(self, events: list[AnomalyEvent], drained_us: int, decode_us: int, detect_us: int) -> None:
        """Tell what was found; with a keeper only once it is written down."""
        detected_us = drained_us + decode_us + detect_us
        statements = []
        for event in events:
            latency_us = {Stage.DECODE: decode_us, Stage.DETECT: detect_us}
            if event.evidence is not None:
                latency_us[Stage.QUEUE] = drained_us - event.received_us
            message = event_message(event, self._identity, detected_us, latency_us)
            key = self._keys.alert(message.kind, message.suspect)
            statements.append(Statement(message, key, encode(message)))
        if self._keeper is not None and statements:
            self._keeper.put(statements)
            return
        for statement in statements:
            self._bus.publish(Channel.ALERT, statement.key, statement.payload)

    def _tell_rejections(self, decoded: Decoded, arrivals: list[Arrival], result: StepResult, now_ns: int) -> None:
        if not self._bus.wanted(Channel.REJECTED):
            return
        by_core = np.flatnonzero(result.outcomes > _WARMING)
        if not (decoded.rejections or by_core.size):
            return
        if now_ns - self._copies_ns >= 1_000_000_000:
            self._copies_ns = now_ns
            self._copies.clear()
        for rejection in decoded.rejections:
            self._tell_rejection(rejection)
        for i in by_core:
            reason = Outcome(result.outcomes[i])
            self._tell_rejection(Rejection(Fault(reason, DETAILS[reason]), arrivals[decoded.sources[i]]))

    def _tell_rejection(self, rejection: Rejection) -> None:
        reason = rejection.fault.reason
        if self._copies[reason] >= self._config.rejected_rate_hz:
            self._ledger.copies_withheld += 1
            return
        self._copies[reason] += 1
        copy = rejected_copy(rejection, payload_max_bytes=self._config.rejected_bytes_limit)
        self._bus.publish(Channel.REJECTED, self._keys.rejected(reason.label), encode(copy))

    def _rest(self, taken: int) -> None:
        """Let a batch gather: the shorter, the longer the turn took beyond a rest, for then it was a large batch."""
        now_ns, idle_s = self._clock.monotonic_ns(), self._config.idle_sleep_s
        if taken:
            self._heard_ns = now_ns
        if self._bus.waiting <= max(taken, _REST_UNLESS_WAITING):
            is_quiet = now_ns - self._heard_ns > _QUIET_NS
            turn_s = (now_ns - self._turned_ns) / 1e9
            self._clock.sleep(idle_s * (_QUIET_REST if is_quiet else idle_s / max(idle_s, turn_s)))

    def _collect(self, *, idle: bool) -> None:
        now_ns = self._clock.monotonic_ns()
        if now_ns - self._collected_ns >= (_COLLECT_IDLE_NS if idle else _COLLECT_NS):
            self._collected_ns = now_ns
            gc.collect()


def _waits_us(decoded: Decoded, arrivals: list[Arrival], drained_ns: int) -> F64:
    """Return (B,) how long each record of the batch was in the queue."""
    received_ns = np.array([arrival.received_ns for arrival in arrivals], dtype=np.int64)
    return (drained_ns - received_ns)[decoded.sources] / 1e3
