"""A client session of a gateway, and the two ways over it: frames onto the bus, alerts off it."""

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import structlog
import zenoh

from headway.bus_options import client_configuration
from headway.errors import zenoh_reason
from headway.gateways.frame_queue import PUT_FAILED, FrameQueue
from headway_schemas.frames import Frame, pack

_RETRY_S: Final = 1.0
_BLOCK_US: Final = 10_000_000
"""How long a put waits for a full transport before zenoh closes it."""
_OPTIONS: Final = (
    ("mode", "client"),
    ("connect/exit_on_failure", True),
    ("transport/link/tx/queue/congestion_control/block/wait_before_close", _BLOCK_US),
)
"""A gateway puts by one router, also where several are named."""
_LINGER_S: Final = 0.001
"""How long frames gather for a bundle."""
_POLL_S: Final = 0.1
BUNDLE_FRAMES: Final = 250
BUNDLE_BYTES: Final = 60_000
"""Below the default of `payload_bytes_limit`."""

_log: Final = structlog.get_logger(__name__)


def open_session(
    endpoints: Sequence[str], zenoh_config: Path | None, stopping: Callable[[], bool]
) -> zenoh.Session | None:
    """Connect as a client, however long it takes; None if it is stopped meanwhile. zenoh connects again by itself.

    Raises
    ------
    UserError
        The endpoints or the file are no configuration of zenoh.
    """
    config = client_configuration(endpoints, zenoh_config, _OPTIONS)
    while not stopping():
        try:
            return zenoh.open(config)
        except zenoh.ZError as error:
            _log.warning("no bus yet", error=zenoh_reason(error), again_in_s=_RETRY_S)
            time.sleep(_RETRY_S)
    return None


class Forwarder:
    """Puts the frames of a queue onto the bus, in bundles, while somebody subscribes.

    Without a subscriber zenoh would drop a put silently. So frames wait, and the stalest give way.
    """

    def __init__(self, queue: FrameQueue, session: zenoh.Session, key: str, encoding: str) -> None:
        self._queue = queue
        self.sent = self.bundles = 0
        self._publisher = session.declare_publisher(
            key, encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK
        )
        self.subscribed = False
        self._publisher.declare_matching_listener(self._on_match)

    def run(self, stopping: Callable[[], bool]) -> None:
        """Forward until it is stopped, then what waits, if somebody subscribes."""
        while not stopping():
            if not self.subscribed:
                time.sleep(_POLL_S)
            elif self._queue.wait(_POLL_S):
                if len(self._queue) < BUNDLE_FRAMES:
                    time.sleep(_LINGER_S)
                self.forward()
        while self.subscribed and len(self._queue):
            self.forward()

    def forward(self) -> None:
        """Put one bundle."""
        frames = self._queue.take(BUNDLE_FRAMES, BUNDLE_BYTES)
        try:
            self._publisher.put(pack(frames))
        except zenoh.ZError as error:
            self._queue.dropped[PUT_FAILED] += len(frames)
            _log.warning("put failed", frames=len(frames), error=zenoh_reason(error))
            return
        self.sent += len(frames)
        self.bundles += 1

    def _on_match(self, status: zenoh.MatchingStatus) -> None:
        self.subscribed = bool(status.matching)


class AlertSource:
    """Takes the alerts of a site off the bus into a queue; the source of a frame is its key."""

    def __init__(self, queue: FrameQueue, session: zenoh.Session, every_alert: str) -> None:
        self._queue = queue
        self._subscriber = session.declare_subscriber(every_alert, self._on_sample)

    def _on_sample(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.PUT:
            frame = Frame(sample.payload.to_bytes(), time.time_ns() // 1000, str(sample.key_expr))
            self._queue.put([frame])


def send_alerts(
    queue: FrameQueue, send: Callable[[Frame], bool], stopping: Callable[[], bool], stopped: threading.Event
) -> int:
    """Hand the alerts of a queue to a broker until it is stopped; an alert that it does not take is tried again.

    Returns how many were handed over.
    """
    sent = 0
    while not stopping():
        if not queue.wait(_POLL_S):
            continue
        for frame in queue.take(1, BUNDLE_BYTES):
            while not (taken := send(frame)) and not stopped.wait(_POLL_S):
                pass
            sent += taken
    return sent
