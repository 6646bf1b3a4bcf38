"""Which machine gets a site: the one with most processors to spare."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from pydantic import BaseModel, ConfigDict


@dataclass(frozen=True, slots=True)
class Node:
    """A machine of the cluster that answers."""

    name: str
    cpus: float


class Placement(BaseModel):
    """A service of a site: started once, on one node, with one epoch."""

    model_config = ConfigDict(frozen=True)

    site: str
    epoch: int
    node: str
    revision: str
    """Of its settings and version."""
    host: str
    """Name of what runs it there."""


def free_cpus(node: Node, placements: Iterable[Placement], cpus: float) -> float:
    """Return the processors that a node has left; each placement takes `cpus`."""
    return node.cpus - cpus * sum(placement.node == node.name for placement in placements)


def choose_node(
    nodes: Iterable[Node],
    placements: Collection[Placement],
    cpus: float,
    *,
    excluded: Collection[str] = (),
    avoided: Mapping[str, float] = MappingProxyType({}),
) -> str | None:
    """Return the node with most processors left, None where no node has `cpus`.

    One that is `avoided` is taken if no other has room, the one with the least number first; one `excluded` never.
    """
    free = {node.name: free_cpus(node, placements, cpus) for node in nodes if node.name not in excluded}
    fitting = [name for name, left in free.items() if left >= cpus]
    return min(fitting, key=lambda name: (avoided.get(name, 0.0), -free[name], name), default=None)
