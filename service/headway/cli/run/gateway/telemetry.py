"""What a gateway tells about itself: metrics and probes; and what it must know of its feed for them."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final, Protocol

import structlog
from prometheus_client import CollectorRegistry, ProcessCollector, generate_latest
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily
from prometheus_client.registry import Collector

from headway.edge.telemetry.http_server import HttpServer
from headway.edge.telemetry.metrics import CONTENT_TYPE
from headway.errors import UserError
from headway.gateways.connection import Connection
from headway.gateways.frame_queue import FrameQueue
from headway_schemas.frames import Frame

_log: Final = structlog.get_logger(__name__)


class Feed(Protocol):
    """What brings frames to a queue, or takes alerts away."""

    @property
    def lost(self) -> int:
        """Messages that are known to be lost before they reached the gateway."""

    @property
    def connection(self) -> Connection | None:
        """The connection to a broker; None without one."""

    @property
    def problem(self) -> str | None:
        """Why nothing can come; None: it can."""

    def run(self, stopping: Callable[[], bool]) -> None:
        """Receive until it is stopped."""

    def close(self) -> None:
        """Release what it holds."""


class AlertFeed(Feed, Protocol):
    """A broker that takes alerts."""

    def send(self, frame: Frame) -> bool:
        """Hand an alert over; False if it is not taken now."""


def telemetry(
    address: tuple[str, int],
    queue: FrameQueue,
    feed: Feed,
    sent: Callable[[], int],
    problem: Callable[[], str | None],
) -> HttpServer:
    """Return the server of a gateway's metrics and probes, which the caller enters.

    Raises
    ------
    UserError
        The address is not available.
    """
    registry = CollectorRegistry()
    registry.register(_Metrics(queue, feed, sent))
    ProcessCollector(registry=registry)
    try:
        server = HttpServer(
            *address,
            metrics=lambda: generate_latest(registry),
            content_type=CONTENT_TYPE,
            liveness_problem=lambda: None,
            readiness_problem=problem,
        )
    except OSError as error:
        raise UserError(f"--http-port {address[1]}: {error.strerror or error}") from None
    _log.info("metrics", http_port=server.port)
    return server


@dataclass(frozen=True, slots=True, eq=False)
class _Metrics(Collector):
    queue: FrameQueue
    feed: Feed
    sent: Callable[[], int]

    def collect(self) -> Iterator[CounterMetricFamily | GaugeMetricFamily]:
        received = CounterMetricFamily("headway_gateway_received", "Messages received, by source.", labels=["source"])
        for source, count in list(self.queue.by_source.items()):
            received.add_metric([source], count)
        yield received
        yield CounterMetricFamily("headway_gateway_sent", "Messages handed over.", value=self.sent())
        dropped = CounterMetricFamily("headway_gateway_dropped", "Messages dropped, by reason.", labels=["reason"])
        for reason, count in list(self.queue.dropped.items()):
            dropped.add_metric([reason], count)
        yield dropped
        yield CounterMetricFamily("headway_gateway_lost", "Messages lost before the gateway.", value=self.feed.lost)
        connection = self.feed.connection
        if connection is not None:
            for name, what, value in (
                ("disconnections", "Losses of the broker's connection.", connection.disconnections),
                ("absent_seconds", "Time without the broker.", connection.absent_s),
                ("sessions_lost", "Times the broker lost what it kept for the gateway.", connection.sessions_lost),
            ):
                yield CounterMetricFamily(f"headway_gateway_{name}", what, value=value)
        yield GaugeMetricFamily("headway_gateway_waiting", "Messages that wait.", value=len(self.queue))
