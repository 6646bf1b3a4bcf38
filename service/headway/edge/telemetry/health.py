"""Who this instance is, whether it lives, and whether it works."""

from dataclasses import dataclass, field

from headway.edge.clock import Clock

ALIVE_WITHIN_S = 2.0


@dataclass(slots=True)
class Vitals:
    """Written by the loop, read by the probes."""

    clock: Clock
    started_ns: int = field(init=False)
    last_turn_ns: int | None = None
    """None until the loop turns: starting is neither dead nor ready."""
    warm: bool = False
    """Kernels are compiled."""
    connected: bool = False
    subscribed: bool = False

    def __post_init__(self) -> None:
        self.started_ns = self.clock.monotonic_ns()

    @property
    def uptime_s(self) -> float:
        """Since the start."""
        return (self.clock.monotonic_ns() - self.started_ns) / 1e9

    @property
    def ailment(self) -> str | None:
        """What would have this process restarted; None: it lives."""
        if self.last_turn_ns is None:
            return None
        still_s = (self.clock.monotonic_ns() - self.last_turn_ns) / 1e9
        return None if still_s <= ALIVE_WITHIN_S else f"the loop has not turned for {still_s:.1f} s"

    @property
    def hindrance(self) -> str | None:
        """What keeps messages from being judged; None: ready."""
        if not self.warm:
            return "kernels are being compiled"
        if not self.connected:
            return "not connected to the bus"
        if not self.subscribed:
            return "not subscribed"
        return self.ailment

    @property
    def ready(self) -> bool:
        """Whether messages are taken in and judged."""
        return self.hindrance is None
