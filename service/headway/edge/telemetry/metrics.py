"""Every metric of the service, in one closed table. Nothing else imports prometheus_client.

A scrape reads the counters of the loop; a message costs no extra work.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from enum import StrEnum, unique
from typing import Any, Final

import numpy as np
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily
from prometheus_client.metrics_core import Metric as Family
from prometheus_client.registry import Collector

from headway.core.types.outcome import Outcome
from headway.edge.cells.cell_engines import CellEngines
from headway.edge.context import ServiceContext
from headway.edge.handover import results
from headway.edge.storage.journal_format import Reason
from headway.edge.storage.persistence import Persistence
from headway.edge.telemetry.latency import EDGES_US, Histogram

CONTENT_TYPE: Final = "text/plain; version=0.0.4; charset=utf-8"
_BUCKET_STRIDE: Final = 6
"""Of the 24 buckets a decade that are counted, four are exported."""


@unique
class Type(StrEnum):
    """Of a metric."""

    COUNTER = "counter"
    GAUGE = "gauge"
    HISTOGRAM = "histogram"


Samples = Iterable[tuple[tuple[str, ...], Any]]
"""Values by label values; of a histogram, a `Histogram`."""


@dataclass(frozen=True, slots=True)
class Metric:
    """One row of the table."""

    name: str
    type: Type
    help: str
    labels: tuple[str, ...]
    read: Callable[[ServiceContext], Samples]


def _one(read: Callable[[ServiceContext], float]) -> Callable[[ServiceContext], Samples]:
    return lambda context: [((), read(context))]


def _of_cells(read: Callable[[CellEngines], float]) -> Callable[[ServiceContext], Samples]:
    return _one(lambda context: read(context.engine) if isinstance(context.engine, CellEngines) else 0)


def _records(context: ServiceContext) -> Samples:
    return [((outcome.label,), context.ledger[outcome]) for outcome in Outcome]


def _events(context: ServiceContext) -> Samples:
    return [((kind.label, str(phase)), n) for (kind, phase), n in list(context.ledger.events.items())]


def _nis(context: ServiceContext) -> Samples:
    ledger = context.ledger
    return [(("below",), ledger.nis_below), (("inside",), ledger.nis_inside), (("above",), ledger.nis_above)]


def _dropped(context: ServiceContext) -> Samples:
    reasons = {**context.bus.dropped, "rejected_copy_rate": context.ledger.copies_withheld}
    return [((reason,), n) for reason, n in reasons.items()]


def _stages(context: ServiceContext) -> Samples:
    return [((str(stage),), histogram) for stage, histogram in context.latencies.stages.items()]


def _persisted(read: Callable[[Persistence], float]) -> Callable[[ServiceContext], Samples]:
    """Read a figure of the persistence; 0 where there is none."""
    return lambda context: [((), 0 if context.persistence is None else read(context.persistence))]


def _journal_failures(context: ServiceContext) -> Samples:
    return [
        ((str(reason),), context.persistence.journal_writer.failed[reason] if context.persistence else 0)
        for reason in Reason
    ]


def _build(context: ServiceContext) -> Samples:
    identity = context.identity
    return [((identity.version, identity.model, identity.config_hash, identity.site, identity.instance), 1)]


_C, _G, _H = Type.COUNTER, Type.GAUGE, Type.HISTOGRAM
TABLE: Final = (
    Metric("headway_build_info", _G, "Always 1; the labels identify the instance.", ("version", "model", "config_hash",
           "site", "instance"),
           _build),
    Metric("headway_ready", _G, "1 when the service receives and scores messages.", (), _one(lambda s: s.health.ready)),
    Metric("headway_connected", _G, "1 when senders can reach the service.", (), _one(lambda s: s.bus.connected)),
    Metric("headway_peers", _G, "zenoh peers, routers and clients connected.", (), _one(lambda s: s.bus.peers)),
    Metric("headway_other_services", _G, "Other services that report health for this site.", (),
           _one(lambda s: len(s.bus.other_services))),
    Metric("headway_messages_total", _C, "Payloads received; a bundle counts as one.", (),
           _one(lambda s: s.bus.received)),
    Metric("headway_records_total", _C, "Records by outcome; each is counted once.", ("outcome",),
           _records),
    Metric("headway_shed_messages_total", _C, "Payloads shed, oldest first: too many waited, or too long.", (),
           _one(lambda s: s.bus.shed)),
    Metric("headway_sequence_gap_messages_total", _C, "Messages missing by gaps in the senders' counters (msg_cnt).",
           (),
           _one(lambda s: s.ledger.sequence_gap_messages)),
    Metric("headway_absent_seconds_total", _C, "Time in which nothing could be received: no bus, or a restart.", (),
           _one(lambda s: s.ledger.absent_s)),
    Metric("headway_disconnected_subscribers_total", _C, "Peers disconnected because they took no alerts.", (),
           _one(lambda s: s.bus.disconnected_subscribers)),
    Metric("headway_publish_dropped_total", _C, "Messages to publish that were dropped, by reason.", ("reason",),
           _dropped),
    Metric("headway_queue_depth", _G, "Payloads that wait in the receive queue.", (), _one(lambda s: s.bus.waiting)),
    Metric("headway_queue_limit", _G, "Most payloads that may wait.", (), _one(lambda s: s.queue_limit)),
    Metric("headway_stage_latency_seconds", _H, "Time of each record by stage; total is receipt to outcome.",
           ("stage",), _stages),
    Metric("headway_loop_iterations_total", _C, "Iterations of the loop.", (), _one(lambda s: s.ledger.iterations)),
    Metric("headway_vehicles", _G, "Vehicles known.", (), _one(lambda s: s.engine.vehicles)),
    Metric("headway_vehicle_capacity", _G, "Most vehicles that may be known.", (), _one(lambda s: s.vehicle_capacity)),
    Metric("headway_engine_restarts_total", _C, "Processes of engines that ended and were started again.", (),
           _of_cells(lambda engines: engines.restarts)),
    Metric("headway_site_handovers_total", _C, "Vehicles sent to and taken up from other sites, and states refused.",
           ("result",),
           lambda s: [((result,), count) for result, count in results(s.handover).items()]),
    Metric("headway_handovers_total", _C, "Vehicles that went from one engine of the site to another.", (),
           _of_cells(lambda engines: engines.handovers)),
    Metric("headway_pairs", _G, "Vehicles with a leader.", (), _one(lambda s: s.engine.pairs)),
    Metric("headway_active_events", _G, "Events not cleared.", (), _one(lambda s: s.engine.active_events)),
    Metric("headway_events_total", _C, "Event updates published.", ("kind", "phase"), _events),
    Metric("headway_alarm_budget_per_hour", _G, "False alarms accepted, per vehicle and hour of clean traffic.", (),
           _one(lambda s: s.alarm_budget_per_hour)),
    Metric("headway_anomalous_readings_total", _C, "Scored readings with a statistic above the gate.", (),
           _one(lambda s: s.ledger.anomalous)),
    Metric("headway_nis_readings_total", _C,
           "Scored readings by the chi-square 95 % band of their NIS; a consistent filter has 95 % inside.", ("band",),
           _nis),
    Metric("headway_covariance_repairs_total", _C, "Covariances repaired.", (),
           _one(lambda s: s.ledger.repairs)),
    Metric("headway_filter_resets_total", _C, "Filters initialised again because their numbers were not finite.", (),
           _one(lambda s: s.ledger.resets)),
    Metric("headway_filter_restarts_total", _C, "Filters initialised again from a reading.", (),
           _one(lambda s: s.ledger.restarts)),
    Metric("headway_leader_changes_total", _C, "Followers whose leader changed.", (),
           _one(lambda s: s.ledger.leader_changes)),
    Metric("headway_evicted_vehicles_total", _C, "Vehicles evicted after vehicle_ttl_s of silence.", (),
           _one(lambda s: s.ledger.evicted)),
    Metric("headway_journal_event_updates_total", _C, "Event updates written to the journal.", (),
           _persisted(lambda k: k.journal_writer.written)),
    Metric("headway_journal_failures_total", _C, "Event updates published but not written to the journal, by reason.",
           ("reason",),
           _journal_failures),
    Metric("headway_journal_published_before_commit_total", _C,
           "Event updates published before their commit because the disk was slow.", (),
           _persisted(lambda k: k.journal_writer.published_before_commit)),
    Metric("headway_journal_pruned_total", _C, "Rows of the journal deleted or reduced: too old or too many.", (),
           _persisted(lambda k: k.journal_writer.pruned)),
    Metric("headway_journal_replaced_total", _C, "Times a new journal was made: deleted or damaged.", (),
           _persisted(lambda k: k.journal_writer.replaced)),
    Metric("headway_journal_waiting", _G, "Event updates that wait to be written.", (),
           _persisted(lambda k: k.journal_writer.waiting)),
    Metric("headway_journal_bytes", _G, "Bytes of the journal and its write-ahead log.",
           (), _persisted(lambda k: k.journal_writer.used_bytes)),
    Metric("headway_snapshots_total", _C, "Snapshots of the detector written.", (),
           _persisted(lambda k: k.snapshots.written)),
    Metric("headway_snapshot_failures_total", _C, "Snapshots that failed to be written.", (),
           _persisted(lambda k: k.snapshots.failed)),
)  # fmt: skip
"""Beside these, `process_*` of the Prometheus client: CPU, memory, file descriptors."""


class Metrics(Collector):
    """The table with its values, as a collector of the Prometheus client."""

    def __init__(self, context: ServiceContext) -> None:
        self._context = context
        self._registry = CollectorRegistry()
        self._registry.register(self)
        ProcessCollector(registry=self._registry)

    def collect(self) -> Iterator[Family]:
        """Yield each metric of the table."""
        for metric in TABLE:
            yield _family(metric, metric.read(self._context))

    def text(self) -> bytes:
        """Return all metrics in Prometheus' text format, of type `CONTENT_TYPE`."""
        return generate_latest(self._registry)


def _family(metric: Metric, samples: Samples) -> Family:
    if metric.type is Type.HISTOGRAM:
        histograms = HistogramMetricFamily(metric.name, metric.help, labels=metric.labels)
        for labels, histogram in samples:
            histograms.add_metric(labels, _buckets(histogram), histogram.sum_us / 1e6)
        return histograms
    of_type = CounterMetricFamily if metric.type is Type.COUNTER else GaugeMetricFamily
    family = of_type(metric.name, metric.help, labels=metric.labels)
    for labels, value in samples:
        family.add_metric(labels, value)
    return family


def _buckets(histogram: Histogram) -> list[tuple[str, float]]:
    cumulated = np.cumsum(histogram.counts)
    exported = range(0, EDGES_US.size, _BUCKET_STRIDE)
    return [(f"{EDGES_US[i] / 1e6:.3g}", float(cumulated[i])) for i in exported] + [("+Inf", float(cumulated[-1]))]
