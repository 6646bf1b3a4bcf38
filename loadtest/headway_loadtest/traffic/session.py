"""A client session on zenoh with explicit endpoints: no scouting, no silent loss."""

import json
import os

import zenoh

os.environ.setdefault("ZENOH_RUNTIME", "(rx: (handover: acc))")
"""zenoh reads this from the environment only; one thread is enough to receive alerts. It equals the setting of the
service, because a service process started from here inherits it and must cost what it costs elsewhere."""

CONNECT_S = 10.0
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


def connect(endpoint: str) -> zenoh.Session:
    """Open a client session with a router or service at `endpoint`, such as `tcp/localhost:7447`.

    Raises
    ------
    SessionError
        No router or service answers within 10 s, or the endpoint is malformed.
    """
    config = zenoh.Config()
    for key, value in (
        ("mode", "client"),
        ("connect/endpoints", [endpoint]),
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
    except zenoh.ZError as error:
        reason = str(error).partition("\n")[0]
        raise SessionError(f"no zenoh at {endpoint}: start `headway serve` or a router there ({reason})") from None
