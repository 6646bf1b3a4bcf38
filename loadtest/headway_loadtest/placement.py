"""Sites over nodes that fail: what is not judged meanwhile, and how much capacity is left. A discrete simulation.

Sites have sizes of a log-normal distribution. A site goes to the node with the least load, the largest site first. A
node fails after an exponential time. Its sites are found missing after `detect_s` and go to other nodes. There each of
them starts and restores its vehicles on a free core, and is not judged until then. A node that has more load than its
cores judges a share of it only. What is measured of one process comes in as `Costs`.
"""

import heapq
import json
import math
import sys
from dataclasses import asdict, dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

F64 = NDArray[np.float64]
HOUR_S, YEAR_S = 3_600.0, 365 * 24 * 3_600.0


@dataclass(frozen=True, slots=True)
class Costs:
    """Of one process on one core, measured; docs/explain/scale.md says where."""

    base_cores: float = 0.13
    """Of a process with few vehicles: its loop and the reader of zenoh wake for each bundle."""
    record_us: float = 3.6
    """Beyond that, in bundles of 25."""
    rate_hz: float = 10.0
    start_s: float = 2.7
    """Of one core until a host and its service of `headway fleet` are ready, kernels cached."""
    restore_us: float = 190.0
    """Of one vehicle from bytes."""
    memory_mb: float = 138.0
    """Of a process without vehicles."""
    vehicle_mb: float = 0.0176
    process_vehicles: int = 10_000
    """Most vehicles of one process; a larger site is several cells."""
    halo: float = 1.25
    """Engines that a record of such a site is given to."""

    def cores(self, vehicles: F64) -> F64:
        """Return the cores that sites keep busy."""
        halo = np.where(vehicles > self.process_vehicles, self.halo, 1.0)
        records_per_s = vehicles * self.rate_hz * halo
        cores: F64 = self.processes(vehicles) * self.base_cores + records_per_s * self.record_us / 1e6
        return cores

    def processes(self, vehicles: F64) -> F64:
        """Return the processes of sites."""
        processes: F64 = np.ceil(vehicles / self.process_vehicles)
        return processes

    def restart_s(self, vehicles: float) -> float:
        """Return the time on one core until a process judges these vehicles again."""
        return self.start_s + vehicles * self.restore_us / 1e6


@dataclass(frozen=True, slots=True)
class Machines:
    """Machines and their faults. The rates are assumptions, to be replaced by those of the operator."""

    nodes: int
    cores: int = 16
    failures_per_year: float = 12.0
    """Of each node, planned restarts without a drain among them."""
    repair_s: float = HOUR_S
    detect_s: float = 2.3
    racks: int = 8
    rack_failures_per_year: float = 0.5
    """Of each rack, all of whose nodes fail together."""


@dataclass(frozen=True, slots=True)
class Simulated:
    """What came of it."""

    failures: int
    moved_sites: int
    unjudged_share: float
    """Of all vehicle-seconds: sites that were moved, and what was beyond the cores."""
    moved_share: float
    """Of all vehicle-seconds: the former alone."""
    outage_p50_s: float
    """Of a site that was moved."""
    outage_p99_s: float
    load_mean: float
    """Share of the cores of a node that is busy, before any failure."""
    load_max: float
    load_peak: float
    """The most that any node ever had; above 1 it does not judge all."""


def site_sizes(vehicles: int, sites: int, sigma: float, rng: np.random.Generator) -> F64:
    """Return the vehicles (S,) of sites, log-normal with shape `sigma`, that add up to `vehicles`."""
    shares = rng.lognormal(0.0, sigma, sites)
    sizes: F64 = shares * (vehicles / shares.sum())
    return sizes


class PlacedSites:
    """Sites on nodes, as they are now."""

    def __init__(self, sizes: F64, plan: Machines, costs: Costs) -> None:
        self._sizes, self._plan, self._costs = sizes, plan, costs
        self._cores = costs.cores(sizes)
        self.load = np.zeros(plan.nodes)
        """(N,) cores that are busy."""
        self.is_up = np.ones(plan.nodes, bool)
        self.node_of = np.full(sizes.size, -1)
        self.place(np.arange(sizes.size))

    def place(self, sites: NDArray[np.intp]) -> None:
        """Put sites that run nowhere on the nodes with the least load, the largest first."""
        up = np.flatnonzero(self.is_up)
        if not up.size:
            return
        heap = [(self.load[node], int(node)) for node in up]
        heapq.heapify(heap)
        for site in sites[np.argsort(-self._cores[sites], kind="stable")]:
            load, node = heap[0]
            self.node_of[site] = node
            heapq.heapreplace(heap, (load + self._cores[site], node))
        for load, node in heap:
            self.load[node] = load

    def fail(self, nodes: NDArray[np.intp]) -> dict[int, float]:
        """Take nodes down at once, move their sites; return the seconds without verdicts by site that has moved."""
        self.is_up[nodes] = False
        self.load[nodes] = 0.0
        lost = np.flatnonzero(np.isin(self.node_of, nodes) | (self.node_of < 0))
        self.node_of[lost] = -1
        free = np.maximum(1, np.floor(self._plan.cores - self.load)).astype(int)
        self.place(lost)
        outages: dict[int, float] = {}
        for node in np.unique(self.node_of[lost]):
            if node >= 0:
                outages |= self._outages(lost[self.node_of[lost] == node], int(free[node]))
        return outages

    def _outages(self, sites: NDArray[np.intp], free: int) -> dict[int, float]:
        """Return when each site judges again: processes start on the free cores, the largest site first."""
        cores, outages = [self._plan.detect_s] * free, dict[int, float]()
        for site in sites[np.argsort(-self._sizes[sites], kind="stable")]:
            processes = int(self._costs.processes(self._sizes[site]))
            for _ in range(processes):
                ready_s = cores[0] + self._costs.restart_s(float(self._sizes[site]) / processes)
                heapq.heapreplace(cores, ready_s)
                outages[int(site)] = max(outages.get(int(site), 0.0), ready_s)
        return outages

    def repair(self, node: int) -> dict[int, float]:
        """Bring a node up, empty; sites that run nowhere start on it. Others stay: to move them costs verdicts."""
        self.is_up[node] = True
        waiting = np.flatnonzero(self.node_of < 0)
        self.place(waiting)
        return self._outages(waiting, self._plan.cores) if waiting.size else {}

    @property
    def beyond(self) -> float:
        """Vehicles that are not judged now: those of no node, and the share of a node's load beyond its cores."""
        share = np.maximum(0.0, 1.0 - self._plan.cores / np.maximum(self.load, 1e-9))
        there = self.node_of >= 0
        return float(self._sizes[~there].sum() + (self._sizes[there] * share[self.node_of[there]]).sum())


def simulate(sizes: F64, plan: Machines, costs: Costs, years: float, seed: int) -> Simulated:
    """Run a fleet for some years."""
    rng, order = np.random.default_rng(seed), count()
    fleet = PlacedSites(sizes, plan, costs)
    first = fleet.load / plan.cores
    events: list[tuple[float, int, str, NDArray[np.intp]]] = []

    def later(now_s: float, rate_per_year: float, what: str, nodes: NDArray[np.intp]) -> None:
        if rate_per_year:
            heapq.heappush(events, (now_s + rng.exponential(YEAR_S / rate_per_year), next(order), what, nodes))

    for node in range(plan.nodes):
        later(0.0, plan.failures_per_year, "fail", np.array([node]))
    for rack in np.array_split(np.arange(plan.nodes), min(plan.racks, plan.nodes)):
        later(0.0, plan.rack_failures_per_year, "fail together", rack)
    now_s, end_s, moved_s, beyond_s, failures, peak = 0.0, years * YEAR_S, 0.0, 0.0, 0, float(first.max())
    outages: list[float] = []
    while events:
        at_s, _, what, nodes = heapq.heappop(events)
        beyond_s += fleet.beyond * (min(at_s, end_s) - now_s)
        now_s = at_s
        if now_s >= end_s:
            break
        if what == "repair":
            gone = [found for node in nodes for found in fleet.repair(int(node)).items()]
        else:
            up = nodes[fleet.is_up[nodes]]
            failures += up.size
            gone = list(fleet.fail(up).items()) if up.size else []
            if up.size:
                heapq.heappush(events, (now_s + plan.repair_s, next(order), "repair", up))
            rate = plan.failures_per_year if what == "fail" else plan.rack_failures_per_year
            later(now_s, rate, what, nodes)
        outages += [seconds for _, seconds in gone]
        moved_s += sum(seconds * sizes[site] for site, seconds in gone)
        peak = max(peak, float(fleet.load.max()) / plan.cores)
    p50_s, p99_s = np.percentile(outages, [50, 99]) if outages else (0.0, 0.0)
    total_s = float(sizes.sum()) * end_s
    shares = (moved_s + beyond_s) / total_s, moved_s / total_s
    return Simulated(
        failures, len(outages), *shares, float(p50_s), float(p99_s), float(first.mean()), float(first.max()), peak
    )


def main(vehicles: int = 1_000_000, sigma: float = 1.0, years: float = 10.0) -> None:
    """Print a line of JSON for each number of sites and of nodes beyond those that all cores need."""
    costs, cores = Costs(), 16
    for sites in (2_500, 250):
        sizes = site_sizes(vehicles, sites, sigma, np.random.default_rng(1))
        busy, processes = float(costs.cores(sizes).sum()), float(costs.processes(sizes).sum())
        memory_gb = (costs.memory_mb * processes + costs.vehicle_mb * vehicles) / 1e3
        for spare in (0, 1, 2, 4):
            nodes = math.ceil(busy / cores) + spare
            found = asdict(simulate(sizes, Machines(nodes, cores), costs, years, seed=1))
            what = {"sites": sites, "processes": processes, "cores_busy": busy, "memory_gb": memory_gb, "nodes": nodes}
            sys.stdout.write(json.dumps({name: float(f"{value:.3g}") for name, value in (what | found).items()}) + "\n")


if __name__ == "__main__":
    main()
