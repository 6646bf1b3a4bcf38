"""The sender: puts each batch on the bus when it is due, whatever happened to the ones before (open loop).

Lateness counts from the intended send time. Puts that block are measured, and messages that could not be put are
counted by reason. While no peer is connected nothing is put, because zenoh would drop it silently.
"""

import time
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import partial
from typing import Protocol

import numpy as np
import zenoh

from headway_loadtest.clock import Clock
from headway_loadtest.measure.percentiles import Histogram
from headway_loadtest.sources.drive import I64
from headway_loadtest.traffic.encode import Batch
from headway_schemas.encodings import BSM_MSGPACK

STALL_S = 0.1
PUT_FAILED, DISCONNECTED = "put_failed", "disconnected"


class Put(Protocol):
    """Sends one payload; blocks while the transport is full. Raises zenoh.ZError when it cannot."""

    def __call__(self, key: zenoh.KeyExpr, payload: bytes, /) -> None:
        """Send one payload."""
        ...


@dataclass(slots=True)
class Sent:
    """What was due so far. `records` counts messages, in bundles or not; `lost` those of them that were not put."""

    records: int = 0
    lost: Counter[str] = field(default_factory=Counter)
    late_us: Histogram = field(default_factory=Histogram)
    """By record, from the intended send time until the put had returned; since the warm-up."""
    stalled_s: float = 0.0
    """Time in batches that took longer than 0.1 s to put."""
    first_event_us: I64 = field(default_factory=lambda: np.zeros(0, np.int64))
    """By row, event time of the first message."""
    last_event_us: I64 = field(default_factory=lambda: np.zeros(0, np.int64))
    """By row, event time of the newest message."""
    cpu_s: float = 0.0

    @property
    def vehicle_hours(self) -> float:
        """Time from the first to the last message, all vehicles together."""
        return float((self.last_event_us - self.first_event_us).sum()) / 3.6e9

    def note_rows(self, rows: I64, event_us: int) -> None:
        """Record the event times of each sender."""
        missing = int(rows.max()) + 1 - len(self.last_event_us)
        if missing > 0:
            self.first_event_us = np.pad(self.first_event_us, (0, missing))
            self.last_event_us = np.pad(self.last_event_us, (0, missing))
        self.last_event_us[rows] = event_us
        self.first_event_us[rows] = np.where(self.first_event_us[rows] == 0, event_us, self.first_event_us[rows])


def put_on(session: zenoh.Session) -> Put:
    """Make the put of a session: without loss while it can wait, at the price of time.

    A key expression handed over whole costs less at both ends than a declared publisher per vehicle.
    """
    block = zenoh.CongestionControl.BLOCK
    return partial(session.put, encoding=zenoh.Encoding(BSM_MSGPACK), congestion_control=block)


def send(
    batches: Iterable[Batch],
    put: Put,
    *,
    clock: Clock,
    warm_ns: int,
    is_up: Callable[[], bool] = lambda: True,
    between: Callable[[Sent, int], None] = lambda _sent, _due_ns: None,
) -> Sent:
    """Put every batch at its time if the other end `is_up`, open loop; what is due before `warm_ns` is not timed.

    `between` is called after each batch with what was sent and when the batch was due; it must be quick.
    """
    sent = Sent()
    cpu_s = time.process_time()
    for batch in batches:
        wait_ns = batch.due_ns - clock.monotonic_ns()
        if wait_ns > 0:
            clock.sleep(wait_ns / 1e9)
        began_ns = clock.monotonic_ns()
        if is_up():
            _put_all(batch, put, sent)
        else:
            sent.lost[DISCONNECTED] += len(batch.rows)
        ended_ns = clock.monotonic_ns()
        sent.records += len(batch.rows)
        if batch.due_ns >= warm_ns:
            sent.late_us.add((ended_ns - batch.due_ns) // 1000, len(batch.rows))
        if ended_ns - began_ns > STALL_S * 1e9:
            sent.stalled_s += (ended_ns - began_ns) / 1e9
        sent.note_rows(batch.rows, batch.last_event_us)
        between(sent, batch.due_ns)
    sent.cpu_s = time.process_time() - cpu_s
    return sent


def _put_all(batch: Batch, put: Put, sent: Sent) -> None:
    for key, payload, records in zip(batch.keys, batch.payloads, batch.records, strict=True):
        try:
            put(key, payload)
        except zenoh.ZError:
            sent.lost[PUT_FAILED] += records
