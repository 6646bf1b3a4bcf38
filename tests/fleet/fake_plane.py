"""A cluster and its bus in memory: a service that was started is on the bus when the test says so."""

from collections.abc import Mapping

from headway.fleet.config import FleetConfig
from headway.fleet.controller import FleetController, FleetState
from headway.fleet.placement import Node


class FakePlane:
    """`controller.ControlPlane`."""

    def __init__(self, **cpus: float) -> None:
        self.cpus = dict(cpus)
        self.started: dict[str, tuple[str, str, int]] = {}
        """Node, site and epoch of each host."""
        self.ends: dict[str, str] = {}
        self.prepared, self.spare_count = 0, 1
        self.stopped: list[str] = []
        self.killed: list[str] = []

    def nodes(self) -> list[Node]:
        return [Node(name, cpus) for name, cpus in self.cpus.items()]

    def start(self, node: str, environment: Mapping[str, str]) -> str:
        site, epoch = environment["HEADWAY_SITE"], int(environment["HEADWAY_EPOCH"])
        host = f"{site}:{epoch}"
        self.started[host] = node, site, epoch
        return host

    def prepare(self) -> None:
        self.prepared += 1

    def spares(self) -> dict[str, int]:
        return dict.fromkeys(self.cpus, self.spare_count)

    def end_of(self, host: str) -> str | None:
        return self.ends.get(host)

    def stop(self, host: str) -> None:
        self.stopped.append(host)

    def kill(self, host: str) -> None:
        self.killed.append(host)


class FakeEpochs:
    """`controller.Epochs`; `claim` is what a service does."""

    def __init__(self) -> None:
        self.of: dict[str, int] = {}
        self.reserved: list[tuple[str, int]] = []

    def newest(self, site: str) -> int:
        return self.of.get(site, 0)

    def reserve(self, site: str, epoch: int) -> None:
        self.reserved.append((site, epoch))
        self.of[site] = epoch


class World:
    """A controller with its cluster, whose services hold their epochs once `ready`."""

    def __init__(self, config: FleetConfig, **cpus: float) -> None:
        self.plane, self.epochs = FakePlane(**cpus), FakeEpochs()
        self.controller = FleetController(FleetState(config=config, release="1+0"), self.plane, self.epochs)
        self.held: set[tuple[str, int]] = set()
        self.now_s = 100.0

    def tick(self, seconds: float = 0.1, *, is_bus_there: bool = True) -> None:
        self.now_s += seconds
        self.controller.tick(self.now_s, frozenset(self.held) if is_bus_there else None)

    def ready(self, host: str) -> None:
        """The service claims its epoch; the one before it stops."""
        _, site, epoch = self.plane.started[host]
        for other, held in list(self.held):
            if other == site:
                self.held.discard((other, held))
                self.plane.ends[f"{site}:{held}"] = "ended with status 3"
        self.epochs.of[site] = epoch
        self.held.add((site, epoch))

    def all_ready(self) -> None:
        """Each service that starts becomes ready."""
        for of in self.controller.state.sites.values():
            if of.next is not None:
                self.ready(of.next.host)
        self.tick()

    def restart(self) -> None:
        """The controller ends, and goes on with what it stored."""
        state = FleetState.model_validate_json(self.controller.state.model_dump_json())
        self.controller = FleetController(state, self.plane, self.epochs)

    def fail(self, node: str) -> None:
        """All services of a node leave the bus at once; Ray does not know yet."""
        for at, site, epoch in self.plane.started.values():
            if at == node:
                self.held.discard((site, epoch))

    @property
    def nodes_of(self) -> dict[str, str]:
        """Node that judges each site."""
        of = self.controller.state.sites
        return {site: state.current.node for site, state in of.items() if state.current is not None}

    @property
    def starting(self) -> dict[str, str]:
        """Node on which each site starts."""
        of = self.controller.state.sites
        return {site: state.next.node for site, state in of.items() if state.next is not None}

    def row(self, site: str) -> dict[str, object]:
        return next(row for row in self.controller.status()["sites"] if row["site"] == site)
