"""The fleet of the tests, and what must hold of it whatever fails."""

import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from fleet.cluster.harness import Observer, RayNodes, Script, ServiceProcess, services, tree
from sim.until import until

SITES = tuple(f"site-{k}" for k in range(1, 9))
VEHICLES, RATE_HZ = 50, 10
SPARES = 2
WAIT_S = 120.0


@dataclass
class World:
    """Nodes, the bus, traffic; and what killed services took with them."""

    nodes: RayNodes
    observer: Observer
    traffic: Script
    config: Path
    unreported: Counter[str] = field(default_factory=Counter)
    """Records of each site that a killed service may have judged after its last report."""

    @property
    def state_dir(self) -> Path:
        return self.config.parent / "state"

    def wait_until_warm(self) -> None:
        """Wait until each site scores all its vehicles."""
        until(lambda: all(self._is_warm(site) for site in SITES), WAIT_S)

    def _is_warm(self, site: str) -> bool:
        newest = self.observer.newest(site)
        return newest is not None and newest.health.vehicles == VEHICLES and newest.health.scored > 20 * VEHICLES

    def epochs(self, sites: list[str]) -> dict[str, int]:
        return {site: self.observer.epoch(site) for site in sites}

    def service(self, site: str) -> ServiceProcess:
        """Return the process that judges a site."""
        return [of for of in services(self.state_dir) if of.site == site][-1]

    def services_on(self, node: str) -> list[ServiceProcess]:
        below = set(tree(self.nodes.raylets[node]))
        return [of for of in services(self.state_dir) if of.pid in below]

    def fullest_node(self, candidates: set[str]) -> str:
        """Return the node that judges most sites."""
        return max(sorted(candidates), key=lambda node: len(self.services_on(node)))

    def note_unreported(self, sites: list[str], at_s: float) -> None:
        """Allow for what the services of these sites judged between their last reports and their end."""
        for site in sites:
            newest = self.observer.newest(site)
            assert newest is not None
            rounds = (at_s - newest.at_s) * RATE_HZ + 2
            self.unreported[site] += round(rounds * VEHICLES)

    def judged_again(self, before: dict[str, int], since_s: float) -> float:
        """Wait until each site is judged by a higher epoch; return after how many seconds the last one was."""
        until(lambda: all(self.observer.judged_again(*of) for of in before.items()), WAIT_S)
        first = [self.observer.judged_again(*of) for of in before.items()]
        return max(report.at_s for report in first if report is not None) - since_s

    def settle(self) -> None:
        """Wait until all vehicles of all sites have been judged for a while."""
        until(lambda: all(self._is_settled(site) for site in SITES), WAIT_S)

    def wait_until_prepared(self) -> None:
        """Wait until each node has its spares, and is known to be up if it is."""
        until_s = time.monotonic() + WAIT_S
        while not self._are_nodes_prepared(rows := self.nodes.status()["nodes"]):
            assert time.monotonic() < until_s, rows
            time.sleep(2.0)  # each look is a process that imports Ray

    def _are_nodes_prepared(self, rows: list[dict]) -> bool:
        names = {row["node"] for row in rows}
        return names == set(self.nodes.raylets) and all(row["spares"] == SPARES for row in rows)

    def _is_settled(self, site: str) -> bool:
        newest = self.observer.newest(site)
        return newest is not None and newest.judged > 10 * VEHICLES and newest.health.vehicles == VEHICLES

    def warming(self, sites: list[str]) -> int:
        """Return the records of the newest epochs whose vehicles warmed up again."""
        return sum(self.observer.reports[site][-1].health.warming for site in sites)

    def publishers_out_of_order(self) -> list[str]:
        """Return the sites with an alert or a report of an older epoch after one of a newer epoch."""
        return [site for site, epochs in self.observer.epochs.items() if list(epochs) != sorted(epochs)]

    def lost_alerts(self) -> list[tuple[str, int]]:
        """Return site and sequence number of each alert that did not come."""
        lost = []
        for site, alerts in self.observer.alerts.items():
            numbers = {alert.sequence or 0 for alert in alerts}
            lost += [(site, number) for number in range(1, max(numbers)) if number not in numbers]
        return lost
