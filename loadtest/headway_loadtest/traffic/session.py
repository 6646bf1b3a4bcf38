"""A client session on zenoh with explicit endpoints: no scouting, no silent loss."""

import json
import os
import re
from pathlib import Path

import zenoh

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: acc))")
"""zenoh reads this from the environment only; one thread is enough to receive alerts. It equals the setting of the
service, because a service process started from here inherits it and must cost what it costs elsewhere."""

CONNECT_S = 5.0
_SOURCE_PLACE = re.compile(r" at /\S+\.rs:\d+\.?")
"""Where in its own sources zenoh found an error: of no use to its user."""
BLOCK_S = 60.0
"""How long a put waits for a full transport before zenoh closes it: an overload shows as latency, not as loss."""


class Connection:
    """Whether a peer is connected, from the events of zenoh: without one a put is dropped silently."""

    def __init__(self, session: zenoh.Session) -> None:
        self._peers: set[str] = set()
        self._listener = session.info.declare_transport_events_listener(self._on_transport, history=True)

    def is_up(self) -> bool:
        """Whether a router or service is connected."""
        return bool(self._peers)

    def close(self) -> None:
        """Stop receiving events."""
        self._listener.undeclare()

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        peer = str(event.transport.zid)
        if event.kind == zenoh.SampleKind.PUT:
            self._peers.add(peer)
        else:
            self._peers.discard(peer)


class SessionError(RuntimeError):
    """No session: one line with the endpoint and what to do."""


def connect(endpoint: str | None, zenoh_config: Path | None = None) -> zenoh.Session:
    """Open a client session with a router or service at `endpoint`, such as `tcp/localhost:7447`.

    `zenoh_config` is a JSON5 file of zenoh's own options, and says where to connect when `endpoint` is None.

    Raises
    ------
    SessionError
        No router or service answers within 5 s, or the endpoint or the file is malformed.
    """
    config = _from_file(zenoh_config) if zenoh_config else zenoh.Config()
    if endpoint is not None:
        try:
            config.insert_json5("connect/endpoints", json.dumps([endpoint]))
        except zenoh.ZError:
            raise SessionError(f"{endpoint!r} is no zenoh endpoint: write it like tcp/127.0.0.1:7447") from None
    for key, value in (
        ("mode", "client"),
        ("connect/timeout_ms", round(CONNECT_S * 1000)),
        ("connect/exit_on_failure", True),
        ("scouting/multicast/enabled", False),
        ("scouting/gossip/enabled", False),
        ("transport/shared_memory/enabled", False),
        ("transport/link/tx/queue/congestion_control/block/wait_before_close", round(BLOCK_S * 1e6)),
    ):
        config.insert_json5(key, json.dumps(value))
    try:
        return zenoh.open(config)
    except zenoh.ZError:
        where = endpoint or f"the endpoints of {zenoh_config}"
        raise SessionError(
            f"nothing answers at {where} within {CONNECT_S:g} s: start `headway serve` or a router there"
        ) from None


def _from_file(file: Path) -> zenoh.Config:
    try:
        return zenoh.Config.from_file(file)
    except zenoh.ZError as error:
        raise SessionError(f"{file}: {_SOURCE_PLACE.sub('', str(error))}") from None
