"""Eight sites of 50 vehicles on three nodes: services, nodes and raylets are killed, stopped and drained.

The tests run in this order on one fleet; the last one holds the accounts of all.
"""

import json
import signal
import time
from collections.abc import Callable, Iterator

import pytest
from faults.harness import network
from fleet.cluster.harness import SeparateNode, alive, send, tree
from fleet.cluster.world import SITES, World
from sim.until import until

pytestmark = pytest.mark.fleet
NODE_S, HOST_S, PLANNED_S = 5.0, 3.0, 1.0
"""Longest time until a site is judged again."""


def test_a_host_that_is_killed(world: World, measured) -> None:
    world.wait_until_prepared()
    site = SITES[0]
    before, service = world.epochs([site]), world.service(site)
    since_s = time.monotonic()
    world.note_unreported([site], since_s)
    send([service.host_pid], signal.SIGKILL)
    again_s = world.judged_again(before, since_s)
    world.settle()
    measured("kill -9 of a host", judged_again_s=round(again_s, 2), must_s=HOST_S, warming=world.warming([site]))
    assert again_s <= HOST_S
    assert world.warming([site]) == 0


@pytest.fixture
def spare_node(world: World, request: pytest.FixtureRequest) -> Iterator[None]:
    """After the test, a node in place of the one that failed, with some sites."""
    yield
    name = f"node-{len(world.nodes.raylets)}-after-{request.node.name}"
    world.nodes.add(name)
    until(lambda: name in {row["node"] for row in world.nodes.status()["nodes"]}, 60.0)
    for site in SITES[:2]:
        world.nodes.fleet("move", site, "--to", name, check=False)


def fail_node(world: World, measured, fault: str, fail: Callable[[int], None], node: str | None = None) -> list[int]:
    """Fail a node, by default the one with most sites; return its services."""
    world.wait_until_prepared()
    node = node or world.fullest_node(set(world.nodes.raylets))
    judging = world.services_on(node)
    sites = [of.site for of in judging]
    raylet, before = world.nodes.raylets.pop(node), world.epochs(sites)
    since_s = time.monotonic()
    world.note_unreported(sites, since_s)
    fail(raylet)
    again_s = world.judged_again(before, since_s)
    world.settle()
    measured(
        fault, sites=len(sites), judged_again_s=round(again_s, 2), must_s=NODE_S, warming=world.warming(sites)
    )  # fmt: skip
    assert sites
    assert again_s <= NODE_S
    assert world.warming(sites) == 0
    return [service.pid for service in judging]


@pytest.mark.usefixtures("spare_node")
def test_a_node_that_is_killed(world: World, measured) -> None:
    fail_node(world, measured, "kill -9 of a node", lambda raylet: send(tree(raylet), signal.SIGKILL))


@pytest.mark.usefixtures("spare_node")
def test_a_raylet_that_is_killed_leaves_no_service(world: World, measured) -> None:
    left = fail_node(world, measured, "kill -9 of a raylet", lambda raylet: send([raylet], signal.SIGKILL))
    assert alive(left) == []


def hang(raylet: int, hung: list[int]) -> None:
    """Stop a node and all its processes, which are noted."""
    hung += tree(raylet)
    send(hung, signal.SIGSTOP)


@pytest.mark.usefixtures("spare_node")
def test_a_node_that_hangs_publishes_nothing_when_it_continues(world: World, measured) -> None:
    hung: list[int] = []
    try:
        left = fail_node(world, measured, "hang of a node", lambda raylet: hang(raylet, hung))
    finally:
        send(hung, signal.SIGCONT)
    until(lambda: not alive(left), 30.0)
    send(hung, signal.SIGKILL)  # a node that hangs for seconds only is up again, and this one is replaced


@pytest.fixture
def separate_node(world: World) -> Iterator[SeparateNode]:
    """A node in a network of its own, with some sites."""
    if not network.IS_POSSIBLE:
        pytest.skip(network.REASON)
    node = SeparateNode("separate", world.nodes.address, cpus=8)
    try:
        until(lambda: node.raylet is not None, 60.0)
        world.nodes.raylets["separate"] = node.raylet
        until(lambda: "separate" in {row["node"] for row in world.nodes.status()["nodes"]}, 60.0)
        for site in SITES[2:4]:
            world.nodes.fleet("move", site, "--to", "separate")
        yield node
    finally:
        world.nodes.raylets.pop("separate", None)
        node.close()


def test_a_node_that_is_cut_off(world: World, measured, separate_node: SeparateNode) -> None:
    left = fail_node(world, measured, "cut of a node", lambda _: separate_node.network.cut(), "separate")
    separate_node.network.join()
    until(lambda: not alive(left), 30.0)


def test_a_node_that_is_drained(world: World, measured) -> None:
    world.wait_until_prepared()
    node = world.fullest_node(set(world.nodes.raylets))
    sites = [of.site for of in world.services_on(node)]
    since_s = time.monotonic()
    rows = json.loads(world.nodes.fleet("drain", node, "--json").stdout)
    assert [row["sites"] for row in rows["nodes"] if row["node"] == node] == [[]]
    world.settle()
    unjudged_s = max(world.observer.unjudged_s(site, since_s) for site in SITES)
    measured(
        "drain of a node",
        sites=len(sites),
        unjudged_s=round(unjudged_s, 2),
        must_s=PLANNED_S,
        warming=world.warming(sites),
    )
    assert sites
    assert unjudged_s <= PLANNED_S
    assert world.warming(sites) == 0


def test_all_services_are_replaced(world: World, measured) -> None:
    world.wait_until_prepared()
    before, since_s = world.epochs(list(SITES)), time.monotonic()
    world.nodes.fleet("up", "--config", str(world.config), "--replace")
    took_s = time.monotonic() - since_s
    world.settle()
    unjudged_s = max(world.observer.unjudged_s(site, since_s) for site in SITES)
    measured(
        "upgrade of all", sites=len(SITES), unjudged_s=round(unjudged_s, 2), must_s=PLANNED_S,
        warming=world.warming(list(SITES)), took_s=round(took_s, 1),
    )  # fmt: skip
    assert all(world.observer.epoch(site) > epoch for site, epoch in before.items())
    assert unjudged_s <= PLANNED_S
    assert world.warming(list(SITES)) == 0


def test_the_accounts_of_all_faults(world: World, measured) -> None:
    world.traffic.end()
    sent: dict[str, int] = world.traffic.read()
    time.sleep(2.0)
    ends = {site: world.observer.ends(site) for site in SITES}
    accounted = {site: sum(end.accounted for end in of) for site, of in ends.items()}
    unaccounted = {site: max(0, sent[site] - accounted[site] - world.unreported[site]) for site in SITES}
    history = {(alert.site, alert.sequence) for alerts in world.observer.alerts.values() for alert in alerts}
    onsets = {alert.event_id for of in world.observer.alerts.values() for alert in of if alert.phase == "onset"}
    measured(
        "all together", sent=sum(sent.values()), accounted=sum(accounted.values()),
        judged=sum(end.judged for of in ends.values() for end in of),
        missed=sum(end.health.sequence_gap_messages for of in ends.values() for end in of),
        rejected=sum(sum(end.health.rejected.values()) for of in ends.values() for end in of),
        unreported=sum(world.unreported.values()), unaccounted=sum(unaccounted.values()),
        alerts=len(history), events=len(onsets), lost_alerts=len(world.lost_alerts()),
        publishers_out_of_order=len(world.publishers_out_of_order()),
    )  # fmt: skip
    assert world.publishers_out_of_order() == []
    assert world.lost_alerts() == []
    assert onsets
    assert unaccounted == dict.fromkeys(SITES, 0)
