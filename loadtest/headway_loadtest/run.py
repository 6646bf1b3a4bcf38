"""One run from end to end: replay frames over the bus, subscribe to the service, and reconcile the counts.

Counts and latency of the service are the difference of two of its health reports: the last one before the first message
and the one after the last outcome.
"""

import gc
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import chain, islice
from typing import NamedTuple, Protocol

import zenoh

from headway_loadtest.clock import Clock, SystemClock
from headway_loadtest.inject.apply import Label
from headway_loadtest.measure.accounting import reconcile
from headway_loadtest.measure.detection import assess
from headway_loadtest.measure.overload import assess_surge
from headway_loadtest.measure.percentiles import Percentiles, measure, of_buckets, of_histogram
from headway_loadtest.measure.result import INTENDED, Outcome, Service
from headway_loadtest.measure.subscriber import Health, Received, Subscriber
from headway_loadtest.traffic.encode import Encoder
from headway_loadtest.traffic.frames import Frame
from headway_loadtest.traffic.schedule import Schedule
from headway_loadtest.traffic.send import Put, Sent, put_on, send
from headway_loadtest.traffic.session import Connection
from headway_loadtest.traffic.surge import Surge
from headway_schemas import Keys, Kind

SERVICE_WAIT_S = 5.0
LEAD_IN_S = 0.2
DRAIN_S = 15.0
QUIET_S = 2.0
PROGRESS_NS = 100_000_000
MINUTE_NS = 60_000_000_000


class Frames(Protocol):
    """Frames with the labels of what was injected into them."""

    @property
    def labels(self) -> list[Label]:
        """Labels so far, in replay time."""
        ...

    def __iter__(self) -> Iterator[Frame]:
        """Yield the frames in order."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Plan:
    """How to replay: in real time or `speed` times as fast, one message or up to `bundle` to a payload.

    `span_s` is the duration of the frames in event time; speeds other than 1 need it, so that event time ends at now.
    The first `warmup_s` seconds count for the ledger but not for latency and cost. Nor does a `surge`, which is part of
    the frames, nor what follows it.
    """

    speed: float = 1.0
    span_s: float = 0.0
    bundle: int = 1
    warmup_s: float = 0.0
    surge: Surge | None = None


class Progress(NamedTuple):
    """Progress of a run, about ten times a second."""

    t_s: float
    """Replay time."""
    sent: int
    alerts: int


@dataclass(frozen=True, slots=True)
class _Run:
    """The data of a run after the last message has its outcome."""

    schedule: Schedule
    warm_ns: int
    ended_ns: int
    sent: Sent
    ids: list[str]
    """By row; the newest where they rotate."""
    ids_ever: set[str]
    received: Received
    reports: list[Health]
    """Of one instance, in order; the first is from before the first message."""


def run(
    session: zenoh.Session,
    frames: Frames,
    keys: Keys,
    plan: Plan,
    on_progress: Callable[[Progress], None] = lambda _progress: None,
    put: Put | None = None,
) -> Outcome:
    """Replay frames over the bus and assess the result; without a service on the site the frames are sent as well.

    `on_progress` is called from the sending loop about ten times a second: it must be quick. `put` sends messages by
    another way than the bus.
    """
    clock = SystemClock()
    subscriber, connection = Subscriber(session, keys, clock), Connection(session)
    try:
        played = _play(put or put_on(session), subscriber, connection, clock, frames, keys, plan, on_progress)
    finally:
        connection.close()
        subscriber.close()
    return _outcome(played, frames.labels, plan)


def _play(
    put: Put,
    subscriber: Subscriber,
    connection: Connection,
    clock: Clock,
    frames: Frames,
    keys: Keys,
    plan: Plan,
    on_progress: Callable[[Progress], None],
) -> _Run:
    _wait(clock, SERVICE_WAIT_S, lambda: bool(subscriber.drain().health))
    instance = subscriber.received.health[0].instance if subscriber.received.health else ""
    to_play = iter(frames)
    first = list(islice(to_play, 1))
    gc.collect()
    gc.freeze()
    schedule = Schedule(
        start_ns=clock.monotonic_ns() + round(LEAD_IN_S * 1e9),
        start_unix_us=time.time_ns() // 1000 + round(LEAD_IN_S * 1e6),
        speed=plan.speed,
        span_s=plan.span_s,
    )
    warm_ns = schedule.start_ns + round(plan.warmup_s * 1e9)
    encoder = Encoder(keys, bundle=plan.bundle)
    progress_ns = 0

    def between(sent: Sent, due_ns: int) -> None:
        nonlocal progress_ns
        if due_ns - progress_ns >= PROGRESS_NS:
            progress_ns = due_ns
            received = subscriber.drain()
            on_progress(Progress((due_ns - schedule.start_ns) * plan.speed / 1e9, sent.records, received.alerts))

    try:
        sent = send(
            encoder.batches(chain(first, to_play), schedule),
            put,
            clock=clock,
            warm_ns=warm_ns,
            is_up=connection.is_up,
            between=between,
        )
    finally:
        gc.unfreeze()
    ended_ns = clock.monotonic_ns()
    _wait(clock, DRAIN_S if instance else QUIET_S, lambda: _is_quiet(subscriber.drain(), instance, ended_ns))
    reports = [report for report in subscriber.received.health if report.instance == instance]
    early = [report for report in reports if report.received_ns < schedule.start_ns]
    return _Run(
        schedule,
        warm_ns,
        ended_ns,
        sent,
        encoder.ids,
        encoder.ids_ever,
        subscriber.received,
        reports[max(0, len(early) - 1) :],
    )


def _wait(clock: Clock, at_most_s: float, done: Callable[[], bool]) -> None:
    deadline_ns = clock.monotonic_ns() + round(at_most_s * 1e9)
    while not done() and clock.monotonic_ns() < deadline_ns:
        clock.sleep(0.05)


def _is_quiet(received: Received, instance: str, ended_ns: int) -> bool:
    """Whether the queue of the service is empty and two reports after the end have the same count."""
    counters = [
        report.counters
        for report in received.health
        if report.instance == instance and report.received_ns > ended_ns + QUIET_S * 1e9 / 2
    ]
    return len(counters) > 1 and not counters[-1].queued and counters[-1].outcomes == counters[-2].outcomes


def _outcome(played: _Run, labels: list[Label], plan: Plan) -> Outcome:
    schedule, sent, received, reports = played.schedule, played.sent, played.received, played.reports
    origin_us = schedule.first_event_us
    episodes = [episode for episode in received.episodes.values() if episode.suspect in played.ids_ever]
    latencies_us = [
        (episode.received_ns - due_ns) / 1e3
        for episode in episodes
        if episode.kind is not Kind.MISS and (due_ns := schedule.due_of_event_ns(episode.onset_us)) >= played.warm_ns
    ]
    quality = assess(
        [replace(label, start_us=label.start_us + origin_us, stop_us=label.stop_us + origin_us) for label in labels],
        episodes,
        schedule=schedule,
        last_us=dict(zip(played.ids, sent.last_event_us.tolist(), strict=False)),
        vehicle_hours=sent.vehicle_hours,
    )
    service = _service(played, plan.surge) if len(reports) > 1 else None
    return Outcome(
        vehicles=len(played.ids),
        seconds=(played.ended_ns - schedule.start_ns) / 1e9,
        warmup_s=plan.warmup_s,
        speed=schedule.speed,
        sent=sent.records,
        late=of_histogram(sent.late_us),
        stalled_s=sent.stalled_s,
        generator_cpu_us=1e6 * sent.cpu_s / max(1, sent.records),
        alert_latency=measure(latencies_us),
        alerts=received.alerts,
        unread=received.unread,
        quality=quality,
        service=service,
    )


def _service(played: _Run, surge: Surge | None) -> Service:
    before, last = played.reports[0], played.reports[-1]
    started_ns, warm_ns = played.schedule.start_ns, played.warm_ns
    measured_until_ns = played.ended_ns if surge is None else started_ns + round(surge.start_s * 1e9)
    timely = [report for report in played.reports if report.received_ns <= measured_until_ns] or played.reports
    timed = last if surge is None else timely[-1]
    warm = next((report for report in played.reports if report.received_ns >= played.warm_ns), before)
    if played.warm_ns <= played.schedule.start_ns:
        warm = before
    busy = [report for report in timely if warm.received_ns < report.received_ns]
    minute = [report for report in timely if report.received_ns >= started_ns + MINUTE_NS]
    sent = played.sent
    return Service(
        instance=last.instance,
        ledger=reconcile(sent.records, sent.lost, before.counters, last.counters),
        stages=_stages(warm, timed),
        cpu_us=_cpu_us(warm, busy[-1] if busy else last),
        rss_mb=last.content.get("rss_mb"),
        rss_warm_mb=warm.content.get("rss_mb"),
        rss_minute_mb=minute[0].content.get("rss_mb") if minute else None,
        surged=None
        if surge is None
        else assess_surge(played.reports, surge, INTENDED, warm_ns=warm_ns, start_ns=started_ns),
    )


def _stages(warm: Health, last: Health) -> dict[str, Percentiles]:
    before, after = warm.content.get("histograms_us", {}), last.content.get("histograms_us", {})
    gained = {stage: of_buckets(dict(before.get(stage, ())), dict(buckets)) for stage, buckets in after.items()}
    return {stage: percentiles for stage, percentiles in gained.items() if percentiles is not None}


def _cpu_us(warm: Health, busy: Health) -> float | None:
    outcomes = busy.counters.outcomes - warm.counters.outcomes
    if outcomes <= 0 or busy.content.get("cpu_s") is None or warm.content.get("cpu_s") is None:
        return None
    used_s: float = busy.content["cpu_s"] - warm.content["cpu_s"]
    return 1e6 * used_s / outcomes
