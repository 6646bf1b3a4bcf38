"""What runs where, and what to do next: a function of time, of the epochs on the bus and of the machines that answer.

A site has a placement that judges it, and at times one that starts. The one that starts judges once its epoch is on
the bus; then the one before has stopped or cannot publish any more (`edge.fence`). A site whose epoch leaves the bus
has failed, whatever its machine says: its epoch is ended by a reservation of the next, and it starts elsewhere. A
planned move starts beside the one that judges, one site at a time.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import Final, Protocol

from pydantic import BaseModel

from headway.errors import UserError
from headway.fleet.config import FleetConfig, environment_of, revision_of
from headway.fleet.placement import Node, Placement, choose_node, free_cpus

START_S: Final = 300.0
"""Longest start: the first one on a machine compiles."""
AVOIDED_S: Final = 60.0
"""A machine on which a site failed is the last choice for so long: Ray may not yet know that it is gone."""
RETRY_S: Final = 1.0
STOP_S: Final = 20.0
"""Longest orderly stop."""

Held = Collection[tuple[str, int]]
"""Site and epoch of each service on the bus."""


class ControlPlane(Protocol):
    """The cluster. No method waits."""

    def nodes(self) -> Sequence[Node]:
        """Return the machines that answer."""

    def start(self, node: str, environment: Mapping[str, str]) -> str:
        """Start a service; return the name of its host."""

    def prepare(self) -> None:
        """Start what makes later starts short; called while no site starts."""

    def spares(self) -> Mapping[str, int]:
        """Return the number of prepared hosts on each node."""

    def end_of(self, host: str) -> str | None:
        """Return how a service or its host ended, None while it runs."""

    def stop(self, host: str) -> None:
        """Let a service stop in order."""

    def kill(self, host: str) -> None:
        """End a service and its host; one that does not answer is fenced."""


class Epochs(Protocol):
    """The epochs of the sites, where all services see them. Methods raise `UserError`, `OSError` or `ValueError`."""

    def newest(self, site: str) -> int:
        """Return the highest epoch so far."""

    def reserve(self, site: str, epoch: int) -> None:
        """End each lower epoch."""


class SiteState(BaseModel):
    """The placements of a site."""

    current: Placement | None = None
    """Judges the site, as far as is known."""
    next: Placement | None = None
    """Starts."""
    target: str | None = None
    """Node on which the site is wanted by a person."""


class FleetState(BaseModel):
    """All that a controller must know after its own restart."""

    config: FleetConfig
    release: str
    """Version of the software that is wanted."""
    sites: dict[str, SiteState] = {}
    drained: set[str] = set()


class FleetController:
    """Brings what runs to what is wanted; the caller stores `state` after each call."""

    def __init__(self, state: FleetState, plane: ControlPlane, epochs: Epochs) -> None:
        self.state = state
        self._plane = plane
        self._epochs = epochs
        self._nodes: dict[str, Node] = {}
        self._held: Held = ()
        self._stopping: dict[str, float] = {}
        """When each host that stops in order is killed."""
        self._avoided: dict[str, float] = {}
        self._started_s: dict[str, float] = {}
        self._retry_s: dict[str, float] = {}
        self._problems: dict[str, str] = {}
        self.apply(state.config, state.release)

    def apply(self, config: FleetConfig, release: str) -> None:
        """Take another wanted state."""
        if config.state_dir != self.state.config.state_dir:
            raise UserError(f"state_dir {config.state_dir}: this fleet has {self.state.config.state_dir}; end it first")
        self.state.config, self.state.release = config, release
        for site in config.sites:
            self.state.sites.setdefault(site, SiteState())

    def drain(self, node: str) -> None:
        """Want no site on a node for as long as it is up. Raises `UserError` for an unknown one."""
        self._require_node(node)
        self.state.drained.add(node)
        for of in self.state.sites.values():
            of.target = None if of.target == node else of.target

    def move(self, site: str, node: str | None) -> str:
        """Want a site on a node, or on the best other one; return its name. Raises `UserError` where it cannot be."""
        if site not in self.state.config.sites:
            raise UserError(f"site {site}: the fleet has {', '.join(sorted(self.state.config.sites))}")
        if node is not None:
            self._require_node(node)
            self.state.drained.discard(node)
        else:
            of = self.state.sites[site]
            here = {placement.node for placement in (of.current, of.next) if placement is not None}
            node = self._choose(excluded=here)
            if node is None:
                raise UserError(f"site {site}: no other node has {self.state.config.cpus:g} processors left")
        self.state.sites[site].target = node
        return node

    def tick(self, now_s: float, held: Held | None) -> None:
        """Do what is due. `held` is None while the bus is away: then no site counts as failed."""
        self._nodes = {node.name: node for node in self._plane.nodes()}
        self.state.drained &= self._nodes.keys()  # one that went comes back as a new one
        self._held = self._held if held is None else held
        for host, until_s in list(self._stopping.items()):
            if now_s > until_s or self._plane.end_of(host) is not None:
                self._plane.kill(host)
                del self._stopping[host]
        for site in list(self.state.sites):
            if site in self.state.config.sites:
                self._advance(site, now_s, held)
            else:
                self._stop(site, now_s)
        if not any(of.next for of in self.state.sites.values()):
            self._plane.prepare()

    def stop_all(self, now_s: float) -> None:
        """Want no site, and stop each in order."""
        self.state.config = self.state.config.model_copy(update={"sites": {}})
        for site in list(self.state.sites):
            self._stop(site, now_s)

    @property
    def hosts(self) -> set[str]:
        """Hosts that are in use."""
        return {placement.host for placement in self._placements()} | self._stopping.keys()

    def status(self) -> dict[str, list[dict[str, object]]]:
        """Return rows for sites and for nodes."""
        placements, cpus, spares = list(self._placements()), self.state.config.cpus, self._plane.spares()
        return {
            "sites": [self._row(site, of) for site, of in sorted(self.state.sites.items())],
            "nodes": [
                {
                    "node": name,
                    "state": "drained" if name in self.state.drained else "up",
                    "sites": sorted(placement.site for placement in placements if placement.node == name),
                    "cpus": node.cpus,
                    "free_cpus": free_cpus(node, placements, cpus),
                    "spares": spares.get(name, 0),
                }
                for name, node in sorted(self._nodes.items())
            ],
        }

    def _row(self, site: str, of: SiteState) -> dict[str, object]:
        held = of.current is not None and (site, of.current.epoch) in self._held
        return {
            "site": site,
            "state": ("moving" if of.next else "judged") if held else ("starting" if of.next else "waiting"),
            "node": of.current.node if of.current else None,
            "epoch": of.current.epoch if of.current else None,
            "next_node": of.next.node if of.next else None,
            "settled": held and of.next is None and not self._is_wanted_elsewhere(site),
            "problem": self._problems.get(site),
        }

    def _advance(self, site: str, now_s: float, held: Held | None) -> None:
        of = self.state.sites[site]
        if of.next is not None and (site, of.next.epoch) in self._held:
            if of.current is not None:
                self._plane.kill(of.current.host)
            of.current, of.next, of.target = of.next, None, None
            self._problems.pop(site, None)
        if of.next is not None and (problem := self._start_problem(of.next, now_s)):
            self._fail(of.next, problem, now_s)
            of.next, self._retry_s[site] = None, now_s + RETRY_S
        if of.next is not None:  # the one before stops by itself, or cannot publish any more
            return
        if of.current is not None and (problem := self._run_problem(of.current, held)):
            self._fail(of.current, problem, now_s)
            of.current = None
        if now_s < self._retry_s.get(site, now_s):
            return
        is_moving = any(other.current and other.next for other in self.state.sites.values())
        if of.current is None or (self._is_wanted_elsewhere(site) and not is_moving):
            self._start(site, now_s)

    def _start_problem(self, placement: Placement, now_s: float) -> str | None:
        if placement.node not in self._nodes:
            return "the node does not answer"
        if now_s - self._started_s.setdefault(placement.host, now_s) > START_S:
            return f"not ready after {START_S:.0f} s"
        return self._plane.end_of(placement.host)

    def _run_problem(self, placement: Placement, held: Held | None) -> str | None:
        if held is not None and (placement.site, placement.epoch) not in held:
            return "silent"
        return self._plane.end_of(placement.host)

    def _fail(self, placement: Placement, problem: str, now_s: float) -> None:
        self._problems[placement.site] = f"epoch {placement.epoch} on {placement.node}: {problem}"
        self._avoided[placement.node] = now_s + AVOIDED_S
        self._plane.kill(placement.host)

    def _start(self, site: str, now_s: float) -> None:
        """Start a service: beside the one that judges, or in place of one that failed."""
        of, state = self.state.sites[site], self.state
        avoided = {node: until_s for node, until_s in self._avoided.items() if now_s < until_s}
        excluded = {of.current.node} if of.current and self._has_wrong_node(of) else set()
        busy = {other.next.node for other in state.sites.values() if other.next} - self._prepared()
        node = of.target if of.target in self._nodes else None
        node = node or self._choose(excluded=excluded | busy, avoided=avoided)
        if node is None and not busy:
            self._problems[site] = f"no node has {state.config.cpus:g} processors left"
        if node is None:
            return
        try:
            epoch = self._epochs.newest(site) + 1
            if of.current is None:
                self._epochs.reserve(site, epoch)
        except (UserError, OSError, ValueError) as error:
            self._problems[site], self._retry_s[site] = str(error), now_s + RETRY_S
            return
        host = self._plane.start(node, environment_of(state.config, site, epoch))
        revision = revision_of(state.config, site, state.release)
        of.next = Placement(site=site, epoch=epoch, node=node, revision=revision, host=host)
        self._started_s[host] = now_s

    def _is_wanted_elsewhere(self, site: str) -> bool:
        """Whether the placement that judges is on a wrong node, or of another revision."""
        of, state = self.state.sites[site], self.state
        if of.current is None or site not in state.config.sites:
            return False
        is_old = of.current.revision != revision_of(state.config, site, state.release)
        return is_old or self._has_wrong_node(of)

    def _has_wrong_node(self, of: SiteState) -> bool:
        if of.current is None:
            return False
        if of.target in self._nodes:
            return of.current.node != of.target
        return of.current.node in self.state.drained

    def _prepared(self) -> set[str]:
        """Return the nodes with a spare; on others one site starts after the other."""
        return {node for node, spares in self._plane.spares().items() if spares}

    def _choose(
        self, *, excluded: Collection[str] = (), avoided: Mapping[str, float] = MappingProxyType({})
    ) -> str | None:
        return choose_node(
            self._nodes.values(),
            list(self._placements()),
            self.state.config.cpus,
            excluded={*excluded, *self.state.drained},
            avoided=avoided,
        )

    def _stop(self, site: str, now_s: float) -> None:
        of = self.state.sites.pop(site)
        for placement in (of.current, of.next):
            if placement is not None:
                self._plane.stop(placement.host)
                self._stopping[placement.host] = now_s + STOP_S

    def _placements(self) -> Iterator[Placement]:
        for of in self.state.sites.values():
            yield from (placement for placement in (of.current, of.next) if placement is not None)

    def _require_node(self, node: str) -> None:
        if node not in self._nodes:
            raise UserError(f"node {node}: the cluster has {', '.join(sorted(self._nodes)) or 'none'}")
