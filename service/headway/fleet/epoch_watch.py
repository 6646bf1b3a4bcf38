"""The epochs that services hold, as seen on the bus: a token leaves it with its process, or after its lease."""

import threading
from collections.abc import Callable, Iterable
from typing import Any, Final

import zenoh

from headway.bus_options import client_configuration
from headway.fleet.config import BusOptions
from headway_schemas.keys import Keys

SETTLED_S: Final = 5.0
"""After the bus is back, services connect again within this time."""
_OPEN_S: Final = 1.0
"""Time between two attempts to reach the bus."""


class EpochWatch:
    """Follows the epochs of sites.

    Parameters
    ----------
    changed
        Called whenever an epoch comes or goes; a thread of zenoh calls it.
    """

    def __init__(self, options: BusOptions, changed: Callable[[], None]) -> None:
        self._config = client_configuration(options.connect, options.zenoh_config)
        self._prefix = options.prefix
        self._changed = changed
        self._lock = threading.Lock()
        self._held: set[tuple[str, int]] = set()
        self._peers: set[str] = set()
        self._session: zenoh.Session | None = None
        self._declared: dict[str, Any] = {}
        self._listener: Any = None
        self._tried_s = self._connected_s = float("-inf")
        self._is_connected = False

    def held(self, sites: Iterable[str], now_s: float) -> frozenset[tuple[str, int]] | None:
        """Return site and epoch of each service on the bus, None while that is not known."""
        session = self._opened(now_s)
        if session is None:
            return None
        for site in sites:
            if site not in self._declared:
                key = Keys(self._prefix, site).every_epoch
                self._declared[site] = session.liveliness().declare_subscriber(key, self._on_token, history=True)
        was_connected, self._is_connected = self._is_connected, bool(self._peers)
        if self._is_connected and not was_connected:
            self._connected_s = now_s
        if not self._is_connected or now_s < self._connected_s + SETTLED_S:
            return None
        with self._lock:
            return frozenset(self._held)

    def close(self) -> None:
        """Leave the bus."""
        if self._session is not None:
            self._session.close()

    def _opened(self, now_s: float) -> zenoh.Session | None:
        if self._session is None and now_s > self._tried_s + _OPEN_S:
            self._tried_s = now_s
            try:
                self._session = zenoh.open(self._config)
            except zenoh.ZError:
                return None
            listen = self._session.info.declare_transport_events_listener
            self._listener = listen(self._on_transport, history=True)
        return self._session

    def _on_token(self, sample: zenoh.Sample) -> None:
        *_, site, _, epoch, _ = str(sample.key_expr).split("/")
        change = self._held.add if sample.kind == zenoh.SampleKind.PUT else self._held.discard
        with self._lock:
            change((site, int(epoch)))
        self._changed()

    def _on_transport(self, event: zenoh.TransportEvent) -> None:
        change = self._peers.add if event.kind == zenoh.SampleKind.PUT else self._peers.discard
        change(str(event.transport.zid))
        self._changed()


def discover(options: BusOptions, seconds: float) -> set[str]:
    """Return the sites whose messages are on the bus within some seconds; all messages come here meanwhile.

    Raises `zenoh.ZError` where the bus cannot be reached.
    """
    found: set[str] = set()
    place, key = options.prefix.count("/") + 1, f"{options.prefix}/*/bsm/**"
    with zenoh.open(client_configuration(options.connect, options.zenoh_config)) as session:
        session.declare_subscriber(key, lambda of: found.add(str(of.key_expr).split("/")[place]))
        threading.Event().wait(seconds)
    return found
