"""The machines of a Ray cluster, and a host on them for each service. A host is an actor that needs no other."""

import uuid
from collections import Counter, defaultdict
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import ray
from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy

from headway.fleet.placement import Node
from headway.fleet.service_host import ServiceHost

NAMESPACE: Final = "headway"
_HOST: Final = "host-"
_ID_LENGTH: Final = 8

Host = ray.remote(max_restarts=0, max_concurrency=4)(ServiceHost)


class RayPlane:
    """`controller.ControlPlane` on Ray.

    Parameters
    ----------
    cpus
        Processors that a host reserves.
    spares
        Idle hosts on each node, ready for their settings: a host and its service take three seconds to start.
    known
        Hosts that run from before; others of that time are ended.
    """

    def __init__(self, cpus: float, spares: int, known: Collection[str]) -> None:
        self._cpus = cpus
        self._spare_count = spares
        self._ids: dict[str, str] = {}
        self._cpus_of: dict[str, float] = {}
        self._hosts: dict[str, Any] = {}
        self._ends: dict[str, Any] = {}
        self._places: dict[str, str] = {}
        """Id of the node of each host."""
        self._spares: defaultdict[str, list[str]] = defaultdict(list)
        """Hosts without a service, by the id of their node."""
        self._ready: dict[str, Any] = {}
        """What waits until a spare is ready."""
        for name in ray.util.list_named_actors():
            if name in known:
                self._hosts[name] = host = ray.get_actor(name)
                self._ends[name] = host.wait.remote()
            elif name.startswith(_HOST):
                ray.kill(ray.get_actor(name))

    def nodes(self) -> Sequence[Node]:
        """Return the nodes that are alive."""
        alive = [node for node in ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0.0) > 0.0]
        count = Counter(node["NodeName"] for node in alive)
        named = {
            node["NodeName"] + (f"-{node['NodeID'][:_ID_LENGTH]}" if count[node["NodeName"]] > 1 else ""): node
            for node in alive
        }
        self._ids = {name: node["NodeID"] for name, node in named.items()}
        self._cpus_of = {node["NodeID"]: float(node["Resources"]["CPU"]) for node in alive}
        return [Node(name, float(node["Resources"]["CPU"])) for name, node in named.items()]

    def start(self, node: str, environment: Mapping[str, str]) -> str:
        """Start a service in a spare host of the node, or in a new one."""
        spares = self._spares[self._ids[node]]
        name = spares.pop(0) if spares else self._new_host(self._ids[node])
        self._ready.pop(name, None)
        self._ends[name] = self._hosts[name].run.remote(dict(environment))
        return name

    def end_of(self, host: str) -> str | None:
        """Return how a service or its host ended, None while it runs."""
        end = self._ends.get(host)
        if end is None:
            return "its host is not known"
        ready, _ = ray.wait([end], timeout=0)
        if not ready:
            return None
        try:
            return f"ended with status {ray.get(end)}"
        except ray.exceptions.RayError as error:
            return f"its host ended: {type(error).__name__}"

    def stop(self, host: str) -> None:
        """Let a service stop in order."""
        if host in self._hosts:
            self._hosts[host].stop.remote()

    def kill(self, host: str) -> None:
        """End a service and its host."""
        self._ends.pop(host, None)
        self._ready.pop(host, None)
        self._places.pop(host, None)
        if host in self._hosts:
            ray.kill(self._hosts.pop(host))

    def prepare(self) -> None:
        """Keep spares on each node that has room; on each one starts after the other."""
        for node_id, cpus in self._cpus_of.items():
            spares, room = self._spares[node_id], int(cpus / self._cpus)
            is_full = sum(place == node_id for place in self._places.values()) >= room
            if len(spares) < self._spare_count and not is_full and all(map(self._is_ready, spares)):
                spares.append(name := self._new_host(node_id))
                self._ready[name] = self._hosts[name].ready.remote()

    def spares(self) -> Mapping[str, int]:
        """Return the number of spares on each node that are ready."""
        return {name: sum(map(self._is_ready, self._spares[node_id])) for name, node_id in self._ids.items()}

    def close(self) -> None:
        """End the spares."""
        for spares in self._spares.values():
            while spares:
                self.kill(spares.pop())

    def _is_ready(self, spare: str) -> bool:
        return bool(ray.wait([self._ready[spare]], timeout=0)[0])

    def _new_host(self, node_id: str) -> str:
        name = f"{_HOST}{uuid.uuid4().hex[:_ID_LENGTH]}"
        affinity = NodeAffinitySchedulingStrategy(node_id, soft=False)
        self._places[name] = node_id
        self._hosts[name] = Host.options(
            name=name, lifetime="detached", num_cpus=self._cpus, scheduling_strategy=affinity
        ).remote()
        return name
