"""What the controller of a fleet does when services, machines and the bus fail, and when people move sites."""

from pathlib import Path

import pytest
from fleet.fake_plane import World

from headway.errors import UserError
from headway.fleet.config import FleetConfig
from headway.fleet.controller import AVOIDED_S, RETRY_S, START_S, STOP_S

SITES = ("s1", "s2", "s3", "s4")


def config(*sites: str, **settings: float) -> FleetConfig:
    return FleetConfig(
        state_dir=Path("/state"), settings={"connect": ["tcp/router:7447"], **settings}, sites={of: {} for of in sites}
    )


@pytest.fixture
def world() -> World:
    """Four sites on three nodes, all judged."""
    world = World(config(*SITES), n1=4, n2=4, n3=4)
    world.tick()
    world.all_ready()
    return world


def test_sites_are_spread_and_each_starts_with_a_reserved_epoch(world: World) -> None:
    assert sorted(world.nodes_of.values()) == ["n1", "n1", "n2", "n3"]
    assert world.epochs.reserved == [(site, 1) for site in SITES]
    assert all(world.row(site)["settled"] for site in SITES)
    world.tick()
    assert len(world.plane.started) == len(SITES)


def test_a_service_has_the_settings_of_its_site_and_a_folder_of_its_own() -> None:
    given = config("s1", delay_s=0.2).model_copy(
        update={"sites": {"s1": {"delay_s": 0.4, "connect": ["tcp/a:1", "tcp/b:1"]}}}
    )
    world, seen = World(given, n1=1), []
    start = world.plane.start
    world.plane.start = lambda node, environment: (seen.append(environment), start(node, environment))[1]
    world.tick()
    assert seen == [
        {
            "HEADWAY_SITE": "s1", "HEADWAY_INSTANCE": "s1", "HEADWAY_EPOCH": "1", "HEADWAY_MODE": "client",
            "HEADWAY_CONNECT": "tcp/a:1,tcp/b:1", "HEADWAY_DELAY_S": "0.4", "HEADWAY_HTTP_PORT": "0",
            "HEADWAY_STATE_DIR": "/state/s1", "HEADWAY_SNAPSHOT_DIR": "/state/s1",
        }
    ]  # fmt: skip


def test_a_silent_site_starts_elsewhere_at_once_with_the_next_epoch_reserved(world: World) -> None:
    before = world.nodes_of
    world.held.discard(("s1", 1))
    world.tick()
    assert world.plane.killed == ["s1:1"]
    assert world.starting.keys() == {"s1"}
    assert world.starting["s1"] != before["s1"]
    assert world.epochs.reserved[-1] == ("s1", 2)
    assert world.row("s1")["state"] == "starting"
    world.all_ready()
    assert world.row("s1")["epoch"] == 2
    assert {site: node for site, node in world.nodes_of.items() if site != "s1"} == {
        site: node for site, node in before.items() if site != "s1"
    }


def test_all_sites_of_a_node_that_fails_start_on_other_nodes_before_ray_knows(world: World) -> None:
    lost = [site for site, node in world.nodes_of.items() if node == "n1"]
    world.fail("n1")
    world.tick()
    assert sorted(world.starting) == lost
    assert "n1" not in world.starting.values()


def test_nothing_is_prepared_while_a_site_starts(world: World) -> None:
    before = world.plane.prepared
    assert before > 0
    world.held.discard(("s1", 1))
    world.tick()
    assert world.plane.prepared == before
    world.all_ready()
    assert world.plane.prepared == before + 1


def test_the_node_of_a_failed_site_is_taken_when_there_is_no_other() -> None:
    world = World(config("s1"), n1=2)
    world.tick()
    world.all_ready()
    world.held.clear()
    world.tick()
    assert world.starting == {"s1": "n1"}


def test_a_node_that_failed_last_is_the_last_choice(world: World) -> None:
    world.plane.spare_count = 0
    world.fail("n3")
    world.tick()
    world.all_ready()
    lost = [site for site, node in world.nodes_of.items() if node == "n2"]
    assert len(lost) == 2
    world.tick(5.0)
    world.fail("n2")
    world.tick()
    assert sorted(world.starting.values()) == ["n1", "n3"]


def test_a_node_is_avoided_for_a_while_only(world: World) -> None:
    for node in ("n2", "n3"):
        del world.plane.cpus[node]
    world.fail("n2")
    world.fail("n3")
    world.tick()
    world.all_ready()
    assert set(world.nodes_of.values()) == {"n1"}
    world.plane.cpus |= {"n2": 4.0, "n3": 4.0}
    world.tick()
    world.tick(AVOIDED_S)
    world.fail("n1")
    world.tick()
    assert set(world.starting.values()) == {"n2", "n3"}


def test_nothing_counts_as_failed_while_the_bus_is_away(world: World) -> None:
    world.held.clear()
    for _ in range(5):
        world.tick(10.0, is_bus_there=False)
    assert not world.starting
    assert world.plane.killed == []


def test_a_host_that_ended_is_replaced_though_the_bus_is_away(world: World) -> None:
    world.plane.ends["s2:1"] = "its host ended"
    world.tick(is_bus_there=False)
    assert world.starting.keys() == {"s2"}


@pytest.mark.parametrize("why", ["ended", "node", "slow"])
def test_a_start_that_fails_is_tried_again_with_a_higher_epoch(world: World, why: str) -> None:
    world.held.discard(("s1", 1))
    world.tick()
    node = world.starting["s1"]
    if why == "ended":
        world.plane.ends["s1:2"] = "ended with status 2"
    elif why == "node":
        del world.plane.cpus[node]
        world.fail(node)
    world.tick(START_S + 1.0 if why == "slow" else 0.1)
    assert "s1" not in world.starting
    assert "s1:2" in world.plane.killed
    assert world.row("s1")["problem"].startswith(f"epoch 2 on {node}: ")
    world.tick(RETRY_S)
    assert world.epochs.reserved[-1] == ("s1", 3)
    assert world.starting["s1"] != node


def test_a_site_without_room_waits_and_says_so() -> None:
    world = World(config(*SITES), n1=3)
    world.tick()
    world.all_ready()
    assert world.row("s4") | {"state": "waiting", "problem": "no node has 1 processors left"} == world.row("s4")
    world.plane.cpus["n2"] = 1.0
    world.tick()
    assert world.starting == {"s4": "n2"}


def test_without_spares_a_node_starts_one_site_after_the_other() -> None:
    world = World(config(*SITES), n1=4, n2=4)
    world.plane.spare_count = 0
    world.tick()
    assert world.starting == {"s1": "n1", "s2": "n2"}
    world.all_ready()
    assert sorted(world.starting) == ["s3", "s4"]
    assert world.row("s3")["problem"] is None


def test_a_drained_node_hands_its_sites_over_one_by_one_beside_those_that_judge(world: World) -> None:
    reserved = list(world.epochs.reserved)
    leaving = sorted(site for site, node in world.nodes_of.items() if node == "n1")
    world.controller.drain("n1")
    for site in leaving:
        world.tick()
        assert list(world.starting) == [site]
        assert world.row(site)["state"] == "moving"
        assert f"{site}:1" not in world.plane.killed
        world.all_ready()
        assert f"{site}:1" in world.plane.killed
    assert "n1" not in world.nodes_of.values()
    assert world.epochs.reserved == reserved, "an epoch that judges is not ended before the next one is ready"
    assert {site for site, _ in world.held} == set(SITES)


def test_the_one_that_judges_may_stop_before_the_next_one_is_on_the_bus(world: World) -> None:
    world.controller.drain("n1")
    world.tick()
    [site] = world.starting
    world.held.discard((site, 1))
    world.plane.ends[f"{site}:1"] = "ended with status 3"
    world.tick()
    assert world.plane.killed == []
    world.all_ready()
    assert world.row(site)["epoch"] == 2


def test_a_planned_start_that_fails_leaves_the_site_where_it_is_judged(world: World) -> None:
    world.controller.move("s1", "n3")
    world.tick()
    world.plane.ends["s1:2"] = "ended with status 2"
    world.tick()
    assert world.row("s1")["state"] == "judged"
    assert world.plane.killed == ["s1:2"]
    world.tick(RETRY_S)
    assert world.starting == {"s1": "n3"}


def test_a_node_that_left_and_came_back_is_not_drained(world: World) -> None:
    world.controller.drain("n1")
    cpus = world.plane.cpus.pop("n1")
    world.fail("n1")
    world.tick()
    world.plane.cpus["n1"] = cpus
    world.tick()
    assert world.controller.state.drained == set()


def test_a_move_goes_to_the_node_named_or_to_the_best_other_one(world: World) -> None:
    world.tick()
    here = world.nodes_of["s2"]
    target = world.controller.move("s2", None)
    assert target != here
    world.tick()
    assert world.starting == {"s2": target}
    world.all_ready()
    assert world.nodes_of["s2"] == target
    world.tick()
    assert not world.starting
    for wrong in (("s9", None), ("s1", "n9")):
        with pytest.raises(UserError):
            world.controller.move(*wrong)
    with pytest.raises(UserError, match="n1, n2, n3"):
        world.controller.drain("n9")


def test_other_settings_or_another_release_replace_the_services_one_by_one(world: World) -> None:
    changed = config(*SITES).model_copy(update={"sites": {site: {} for site in SITES} | {"s2": {"delay_s": 0.3}}})
    world.controller.apply(changed, "1+0")
    world.tick()
    assert list(world.starting) == ["s2"]
    world.all_ready()
    world.controller.apply(changed, "2+0")
    assert not any(world.row(site)["settled"] for site in SITES)
    for _ in SITES:
        world.tick()
        assert len(world.starting) == 1
        world.all_ready()
    world.tick()
    assert not world.starting
    assert {site: world.row(site)["epoch"] for site in SITES} == {"s1": 2, "s2": 3, "s3": 2, "s4": 2}
    assert world.epochs.reserved == [(site, 1) for site in SITES]


def test_a_site_that_is_not_wanted_any_more_stops_in_order(world: World) -> None:
    world.controller.apply(config("s1", "s2", "s3"), "1+0")
    world.tick()
    assert world.plane.stopped == ["s4:1"]
    assert world.controller.hosts == {"s1:1", "s2:1", "s3:1", "s4:1"}
    world.plane.ends["s4:1"] = "ended with status 0"
    world.tick()
    assert world.controller.hosts == {"s1:1", "s2:1", "s3:1"}


def test_all_stop_in_order_and_one_that_does_not_is_killed(world: World) -> None:
    world.controller.stop_all(world.now_s)
    assert sorted(world.plane.stopped) == [f"{site}:1" for site in SITES]
    world.plane.ends |= {f"{site}:1": "ended with status 0" for site in SITES[1:]}
    world.tick()
    assert world.controller.hosts == {"s1:1"}
    world.tick(STOP_S)
    assert world.controller.hosts == set()


def test_a_controller_that_ended_goes_on_where_it_was(world: World) -> None:
    world.controller.drain("n1")
    world.tick()
    nodes, starting = world.nodes_of, world.starting
    world.restart()
    world.tick(is_bus_there=False)
    assert (world.nodes_of, world.starting) == (nodes, starting)
    assert len(world.plane.started) == len(SITES) + 1
    world.all_ready()
    assert len(world.plane.killed) == 1


def test_another_folder_is_refused(world: World) -> None:
    with pytest.raises(UserError, match="state_dir"):
        world.controller.apply(config("s1").model_copy(update={"state_dir": Path("/other")}), "1+0")
