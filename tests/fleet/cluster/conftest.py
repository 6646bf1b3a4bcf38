"""A fleet of 8 sites on 3 nodes and its traffic, for all tests of this folder; they run only when asked for by mark."""

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from faults.harness.processes import Router
from fleet.cluster.harness import Observer, RayNodes, Script, services
from fleet.cluster.world import SITES, SPARES, VEHICLES, World
from sim.loopback import free_endpoint
from sim.until import until

ROOT = Path(__file__).resolve().parents[3]
NODES = ("node-1", "node-2", "node-3")
_ROWS = pytest.StashKey[list[dict]]()


def pytest_ignore_collect(config: pytest.Config) -> bool | None:
    return None if config.option.markexpr == "fleet" else True


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ROWS] = []


@pytest.fixture(scope="session")
def measured(request: pytest.FixtureRequest):
    """Notes a row of the table: what was done, and figures."""

    def note(fault: str, **figures: object) -> None:
        load = round(os.getloadavg()[0], 1)
        request.config.stash[_ROWS].append({"fault": fault, **figures, "load_average": load})

    return note


@pytest.fixture(scope="session")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """The fleet, judged and warm."""
    pytest.importorskip("ray", reason="needs Ray: pip install 'headway[fleet]'")
    folder, nodes = tmp_path_factory.mktemp("fleet"), RayNodes()
    host, port = nodes.address.partition(":")[0], free_endpoint().rpartition(":")[2]
    endpoint = f"tcp/{host}:{port}"  # which a node in a network of its own reaches
    config = folder / "fleet.toml"
    config.write_text(
        f'state_dir = "{folder / "state"}"\nspares = {SPARES}\n'
        f'[settings]\nconnect = ["{endpoint}"]\nhealth_interval_s = 0.1\n'
        "vehicle_capacity = 500\nsuspect_burst = 10_000\n" + "".join(f"[sites.{site}]\n" for site in SITES)
    )
    for name in NODES:
        nodes.add(name)
    with nodes.script, Router(endpoint, ROOT / "deploy" / "zenoh" / "trial.json5") as router:
        until(lambda: router.ready)
        observer = Observer(endpoint)
        try:
            nodes.fleet("up", "--config", str(config))
            with Script(
                "traffic_process.py", "--endpoint", endpoint, "--sites", *SITES, "--vehicles", str(VEHICLES)
            ) as traffic:
                world = World(nodes, observer, traffic, config)
                world.wait_until_warm()
                yield world
            nodes.fleet("down")
            until(lambda: not services(folder / "state"))
        finally:
            observer.close()
            for service in services(folder / "state"):
                service.kill()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    rows = config.stash[_ROWS]
    if not rows:
        return
    terminalreporter.section("fleet")
    for row in rows:
        terminalreporter.write_line("  ".join(f"{name} {value}" for name, value in row.items()))
    (ROOT / "out").mkdir(exist_ok=True)
    file = ROOT / "out" / f"fleet-{time.strftime('%Y%m%dT%H%M%S')}.json"
    file.write_text(json.dumps(rows, indent=1), encoding="utf-8")
