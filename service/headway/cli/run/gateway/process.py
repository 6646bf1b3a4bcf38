"""A gateway as a process: the feed, the bus, metrics and probes, until it is told to stop."""

import signal
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import structlog

from headway.cli.run.bus import BusAccess, bus_access
from headway.cli.run.gateway.telemetry import AlertFeed, Feed, telemetry
from headway.edge.telemetry import logging_setup
from headway.errors import UserError
from headway.gateways.bus_port import BUNDLE_BYTES, AlertSource, Forwarder, open_session, send_alerts
from headway.gateways.frame_queue import FrameQueue
from headway_schemas.encodings import CAM_JSON, CAM_UPER, J2735_ODE, J2735_RAW, J2735_UPER
from headway_schemas.frames import Frame
from headway_schemas.keys import GATEWAY_PREFIX, Keys, is_id

FORMS: Final = {
    "j2735-uper": J2735_UPER, "ode": J2735_ODE, "j2735-json": J2735_RAW, "cam-uper": CAM_UPER, "cam-json": CAM_JSON,
}  # fmt: skip
"""Forms of what a feed brings, and their encodings on the bus."""
FRAMES_LIMIT: Final = 100_000

_log: Final = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class GatewayOptions:
    """What all gateways have in common."""

    name: str
    form: str
    http_host: str
    http_port: int

    @property
    def encoding(self) -> str:
        """Encoding on the bus. Raises `UserError`."""
        if self.form not in FORMS:
            raise UserError(f"--form {self.form}: choose from {', '.join(FORMS)}")
        return FORMS[self.form]

    def key(self, keys: Keys) -> str:
        """Key of the gateway on the bus. Raises `UserError`."""
        if not is_id(self.name):
            raise UserError(f"--name {self.name}: letters, digits and _ . ~ - only")
        return keys.bsm(GATEWAY_PREFIX + self.name.removeprefix(GATEWAY_PREFIX))


def access(config: Path | None, connect: Sequence[str] | None, site: str | None) -> BusAccess:
    """Return where the bus is, and the site that is meant."""
    bus = bus_access(config, connect)
    return replace(bus, site=site or bus.site)


def forward(make: Callable[[FrameQueue], Feed], options: GatewayOptions, bus: BusAccess) -> None:
    """Forward what a feed brings onto the bus.

    Raises
    ------
    UserError
        An option is wrong, or an address is not available.
    """
    stop = _stop_on_signal()
    key, encoding = options.key(Keys(bus.prefix, bus.site)), options.encoding
    queue = FrameQueue(FRAMES_LIMIT, BUNDLE_BYTES)
    feed = make(queue)
    session = open_session(bus.endpoints, bus.zenoh_config, stop.is_set)
    if session is None:
        feed.close()
        return
    forwarder = Forwarder(queue, session, key, encoding)

    def problem() -> str | None:
        return feed.problem or (None if forwarder.subscribed else "no service subscribes on the bus")

    receiver = threading.Thread(target=feed.run, args=(stop.is_set,), name="gateway-feed")
    with telemetry((options.http_host, options.http_port), queue, feed, lambda: forwarder.sent, problem):
        receiver.start()
        _log.info("gateway ready", key=key, encoding=encoding)
        forwarder.run(stop.is_set)
        receiver.join()
    account = _account(queue, feed, forwarder.sent)
    feed.close()
    session.close()
    _log.info("gateway stopped", **account)


def forward_alerts(make: Callable[[FrameQueue], AlertFeed], options: GatewayOptions, bus: BusAccess) -> None:
    """Forward the alerts of a site to a broker.

    Raises
    ------
    UserError
        An option is wrong.
    """
    stop = _stop_on_signal()
    queue = FrameQueue(FRAMES_LIMIT, 1 << 24)
    feed = make(queue)
    session = open_session(bus.endpoints, bus.zenoh_config, stop.is_set)
    if session is None:
        feed.close()
        return
    sent = [0]

    def send(frame: Frame) -> bool:
        taken = feed.send(frame)
        sent[0] += taken
        return taken

    with telemetry((options.http_host, options.http_port), queue, feed, lambda: sent[0], lambda: feed.problem):
        source = AlertSource(queue, session, Keys(bus.prefix, bus.site).every_alert)
        _log.info("alert gateway ready", site=bus.site)
        send_alerts(queue, send, stop.is_set, stop)
        del source
    account = _account(queue, feed, sent[0])
    feed.close()
    session.close()
    _log.info("alert gateway stopped", **account)


def _stop_on_signal() -> threading.Event:
    logging_setup.configure("info", "console")
    stop = threading.Event()
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: stop.set())
    return stop


def _account(queue: FrameQueue, feed: Feed, sent: int) -> dict[str, object]:
    dropped = {reason: count for reason, count in queue.dropped.items() if count}
    return {"received": queue.received, "sent": sent, "dropped": dropped, "waiting": len(queue), "lost": feed.lost}
