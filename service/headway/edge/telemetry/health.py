"""Liveness and readiness of this instance, as Kubernetes defines them."""

from dataclasses import dataclass, field

from headway.edge.clock import Clock

ALIVE_WITHIN_S = 2.0


@dataclass(slots=True)
class HealthState:
    """Written by the loop, read by the probes."""

    clock: Clock
    started_ns: int = field(init=False)
    last_iteration_ns: int | None = None
    """None until the first iteration: a starting service is alive but not ready."""
    warm: bool = False
    """Kernels are compiled."""
    connected: bool = False
    subscribed: bool = False
    problem: str | None = None
    """Of the processes of the engines; None: none."""

    def __post_init__(self) -> None:
        self.started_ns = self.clock.monotonic_ns()

    @property
    def uptime_s(self) -> float:
        """Seconds since the start."""
        return (self.clock.monotonic_ns() - self.started_ns) / 1e9

    @property
    def liveness_problem(self) -> str | None:
        """Why this process needs a restart; None: it is alive."""
        if self.last_iteration_ns is None:
            return None
        still_s = (self.clock.monotonic_ns() - self.last_iteration_ns) / 1e9
        return None if still_s <= ALIVE_WITHIN_S else f"no loop iteration for {still_s:.1f} s"

    @property
    def readiness_problem(self) -> str | None:
        """Why messages are not processed; None: ready."""
        if not self.warm:
            return "kernels are being compiled"
        if not self.connected:
            return "not connected to the bus"
        if not self.subscribed:
            return "not subscribed"
        if self.problem is not None:
            return self.problem
        return self.liveness_problem

    @property
    def ready(self) -> bool:
        """Whether messages are received and processed."""
        return self.readiness_problem is None
