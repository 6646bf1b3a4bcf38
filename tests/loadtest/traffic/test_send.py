from dataclasses import dataclass, field

import numpy as np
import pytest
import zenoh

from headway_loadtest.measure.percentiles import of_histogram
from headway_loadtest.traffic.encode import Batch
from headway_loadtest.traffic.send import send

MS = 1_000_000
KEY = zenoh.KeyExpr("v2x/crossing/bsm/a")


@dataclass
class FakeClock:
    now_ns: int = 0
    slept_ns: list[int] = field(default_factory=list)

    def monotonic_ns(self):
        return self.now_ns

    def sleep(self, seconds):
        self.slept_ns.append(round(seconds * 1e9))
        self.now_ns += round(seconds * 1e9)


class FakeBus:
    """Takes a microsecond for a put, and stalls in those it is told to."""

    def __init__(self, clock, stalls_ns=None, failing=()):
        self.clock = clock
        self.stalls_ns = stalls_ns or {}
        self.failing = failing
        self.at_ns = []

    def __call__(self, _key, _payload):
        number = len(self.at_ns)
        self.at_ns.append(self.clock.now_ns)
        self.clock.now_ns += self.stalls_ns.get(number, 1000)
        if number in self.failing:
            raise zenoh.ZError("closed")


def batch(due_ms, records=1):
    return Batch(due_ms * MS, [KEY] * records, [b"x"] * records, [1] * records, np.arange(records), due_ms * 1000)


def sent(batches, clock=None, warm_ms=0, **options):
    clock = clock or FakeClock()
    bus = FakeBus(clock, **options)
    return send(batches, bus, clock=clock, warm_ns=warm_ms * MS), bus


def test_each_batch_leaves_when_it_is_due():
    result, bus = sent([batch(5), batch(8), batch(20)])
    assert bus.at_ns == [5 * MS, 8 * MS, 20 * MS]
    assert result.records == 3


def test_a_stall_cannot_hide_latency():
    result, bus = sent([batch(ms) for ms in range(1000)], stalls_ns={100: 500 * MS})
    late = of_histogram(result.late_us)
    assert bus.at_ns[101] == 600 * MS
    assert late.max == pytest.approx(500.0, rel=1e-2)
    # What was due during the stall, half of the run, is late by what was left of it.
    later = sum(count for edge_us, count in result.late_us.counts.items() if edge_us > 250_000)
    assert later == pytest.approx(250, rel=0.02)
    assert late.p99 > 450.0
    assert result.stalled_s == pytest.approx(0.5)


def test_nobody_waits_when_late():
    clock = FakeClock()
    sent([batch(0), batch(1), batch(2)], clock=clock, stalls_ns={0: 10 * MS})
    assert clock.slept_ns == []


def test_the_warm_up_is_sent_but_not_timed():
    result, _ = sent([batch(ms) for ms in range(100)], warm_ms=60)
    assert result.records == 100
    assert of_histogram(result.late_us).count == 40


def test_what_cannot_be_put_is_counted_and_the_rest_goes_on():
    result, bus = sent([batch(1, 2), batch(2), batch(3)], failing={1, 2})
    assert result.lost == {"put_failed": 2}
    assert len(bus.at_ns) == 4


def test_a_bundle_that_cannot_be_put_is_lost_by_its_records():
    bundles = Batch(0, [KEY, KEY], [b"x", b"y"], [25, 7], np.arange(32), 0)
    result, _ = sent([bundles], failing={0})
    assert (result.records, result.lost) == (32, {"put_failed": 25})


def test_nothing_is_put_while_the_other_end_is_away():
    clock = FakeClock()
    bus = FakeBus(clock)
    batches = [batch(ms, 2) for ms in range(10)]
    result = send(batches, bus, clock=clock, warm_ns=0, is_up=lambda: not 3 * MS <= clock.now_ns < 6 * MS)
    assert (result.records, result.lost) == (20, {"disconnected": 6})
    assert len(bus.at_ns) == 14


def test_lateness_is_by_record():
    result, _ = sent([batch(1, 10), batch(2, 30)])
    assert of_histogram(result.late_us).count == 40


def test_hours_driven_are_from_first_to_last_message():
    result, _ = sent([batch(ms, 2) for ms in (1, 1801, 3601)])
    assert result.vehicle_hours == pytest.approx(2 * 3.6 / 3600)


def test_the_last_message_of_each_sender_is_known():
    result, _ = sent([batch(1, 3), batch(2, 2), batch(3, 5)])
    assert result.last_event_us[:5].tolist() == [3000] * 5
    result, _ = sent([batch(1, 3), batch(2, 2)])
    assert result.last_event_us[:3].tolist() == [2000, 2000, 1000]


def test_progress_is_told_after_each_batch():
    progress = []
    clock = FakeClock()
    send(
        [batch(1), batch(2)],
        FakeBus(clock),
        clock=clock,
        warm_ns=0,
        between=lambda so_far, due_ns: progress.append((so_far.records, due_ns // MS)),
    )
    assert progress == [(1, 1), (2, 2)]
