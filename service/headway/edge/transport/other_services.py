"""Other services of the same site, known by their health reports: each of them judges every vehicle once more."""

from typing import Final

import structlog

from headway.edge.clock import Clock
from headway_schemas.keys import Keys

_SEEN_NS: Final = 30_000_000_000
"""A service that reported no health for so long has ended."""

_log: Final = structlog.get_logger(__name__)


class OtherServices:
    """Those that report health for the site and are not this process; one may have its instance name."""

    def __init__(self, keys: Keys, clock: Clock) -> None:
        self._keys = keys
        self._clock = clock
        self._seen_ns: dict[str, int] = {}

    def report(self, key: str) -> None:
        """Take the key of a health report of another process; any thread may call this."""
        address = self._keys.parse(key)
        if address is None:
            return
        [instance] = address.chunks
        is_new = instance not in self.instances
        self._seen_ns[instance] = self._clock.monotonic_ns()
        if is_new:
            _log.warning("another service judges this site: events are published by both", other=instance)

    @property
    def instances(self) -> tuple[str, ...]:
        """The instances that run now, by name."""
        since_ns = self._clock.monotonic_ns() - _SEEN_NS
        return tuple(sorted(name for name, seen_ns in self._seen_ns.copy().items() if seen_ns > since_ns))
