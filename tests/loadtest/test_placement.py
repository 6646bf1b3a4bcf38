"""The arithmetic of the simulation of placement, against sums by hand."""

import numpy as np
import pytest

from headway_loadtest.placement import YEAR_S, Costs, Machines, PlacedSites, simulate, site_sizes

COSTS = Costs(base_cores=0.1, record_us=4.0, start_s=1.0, restore_us=200.0, process_vehicles=10_000, halo=1.25)
QUIET = Machines(nodes=2, cores=4, failures_per_year=0.0, rack_failures_per_year=0.0, detect_s=2.0)


def plan(**changes: float) -> Machines:
    return Machines(**{name: changes.get(name, getattr(QUIET, name)) for name in Machines.__slots__})


def test_a_site_beyond_one_process_is_several_whose_records_at_borders_are_judged_twice() -> None:
    assert COSTS.cores(np.array([1_000.0, 20_000.0])) == pytest.approx([0.1 + 0.04, 2 * 0.1 + 1.25 * 0.8])
    assert COSTS.processes(np.array([1.0, 10_000.0, 10_001.0])).tolist() == [1, 1, 2]


def test_sizes_add_up() -> None:
    sizes = site_sizes(1_000_000, 2_500, 1.0, np.random.default_rng(1))
    assert sizes.sum() == pytest.approx(1_000_000)
    assert np.log(sizes).std() == pytest.approx(1.0, rel=0.05)


def test_no_node_has_more_than_the_mean_and_one_site() -> None:
    sizes = site_sizes(100_000, 200, 1.0, np.random.default_rng(1))
    fleet = PlacedSites(sizes, plan(nodes=5), COSTS)
    cores = COSTS.cores(sizes)
    assert fleet.load.sum() == pytest.approx(cores.sum())
    assert fleet.load.max() <= cores.sum() / 5 + cores.max()
    assert fleet.load == pytest.approx([cores[fleet.node_of == node].sum() for node in range(5)])


def test_a_failed_nodes_sites_start_on_the_free_cores_of_the_others() -> None:
    """Ten sites of 1,000 vehicles take 0.14 cores each, so 3 of 4 cores are free: two rounds of starts."""
    fleet = PlacedSites(np.full(10, 1_000.0), QUIET, COSTS)
    outages = fleet.fail(np.array([0]))
    assert sorted(outages.values()) == pytest.approx([2.0 + 1.2] * 3 + [2.0 + 2 * 1.2] * 2)
    assert (fleet.node_of == 1).all()
    assert fleet.load == pytest.approx([0.0, 1.4])
    assert fleet.beyond == 0.0


def test_without_a_node_nothing_is_judged_until_one_is_repaired() -> None:
    fleet = PlacedSites(np.array([1_000.0, 3_000.0]), QUIET, COSTS)
    assert fleet.fail(np.array([0, 1])) == {}
    assert fleet.beyond == 4_000.0
    assert fleet.repair(1) == pytest.approx({0: 2.0 + 1.2, 1: 2.0 + 1.6})
    assert fleet.beyond == 0.0


def test_a_node_with_more_load_than_cores_judges_a_share() -> None:
    """10,000 vehicles take 0.5 cores, so eight sites take 4 cores on two nodes, and half of them are judged on one."""
    fleet = PlacedSites(np.full(8, 10_000.0), plan(cores=2), COSTS)
    assert fleet.beyond == 0.0
    fleet.fail(np.array([0]))
    assert fleet.beyond == pytest.approx(40_000.0)


def test_the_share_that_is_not_judged_is_the_rate_of_failures_times_their_length() -> None:
    found = simulate(np.full(100, 1_000.0), plan(nodes=100, failures_per_year=50.0, repair_s=60.0), COSTS, 4.0, seed=1)
    assert found.failures == pytest.approx(100 * 50 * 4, rel=0.03)
    assert found.outage_p50_s == pytest.approx(3.2)
    assert found.moved_share == pytest.approx(found.moved_sites * 3.2 / (100 * 4 * YEAR_S), rel=0.01)
    assert found.unjudged_share == pytest.approx(found.moved_share)


def test_racks_fail_together() -> None:
    found = simulate(np.full(8, 1_000.0), plan(nodes=8, racks=2, rack_failures_per_year=100.0), COSTS, 1.0, seed=1)
    assert found.failures == pytest.approx(8 * 100, rel=0.2)
    assert found.failures % 4 == 0


def test_the_same_seed_gives_the_same() -> None:
    sizes = np.full(20, 500.0)
    runs = [simulate(sizes, plan(failures_per_year=12.0), COSTS, 1.0, seed) for seed in (1, 1, 2)]
    assert runs[0] == runs[1] != runs[2]
