"""What `headway fleet` does: requests to the controller in the Ray cluster, and their answers."""

import json
import logging
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import ray
import zenoh
from rich.console import Console
from rich.table import Table

from headway.errors import UserError, zenoh_reason
from headway.fleet.config import bus_options, read_config
from headway.fleet.epoch_watch import discover
from headway.fleet.ray_controller import ControllerHost
from headway.fleet.ray_plane import NAMESPACE
from headway.version import version

_CONTROLLER: Final = "fleet"
_HEAD: Final = "node:__internal_head__"
"""Resource that Ray gives to the head of a cluster."""
_POLL_S: Final = 0.2
_COLUMNS: Final = {"sites": ("site", "state", "node", "epoch", "next_node", "problem"),
                   "nodes": ("node", "state", "sites", "cpus", "free_cpus", "spares")}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Waiting:
    """What all requests have in common."""

    address: str
    wait_s: float
    as_json: bool


def up(file: Path, discover_s: float, waiting: Waiting, *, replace: bool) -> int:
    """Start the controller if there is none, and give it what is wanted."""
    config = read_config(file, may_be_empty=discover_s > 0.0)
    if discover_s > 0.0:
        try:
            config = read_config(file, discover(bus_options(config), discover_s))
        except zenoh.ZError as error:
            raise UserError(f"{file}: {zenoh_reason(error)}") from None
    _connect(waiting.address)
    wanted = config.model_dump_json()
    options = {
        "name": _CONTROLLER, "lifetime": "detached", "get_if_exists": True, "num_cpus": 0, "resources": {_HEAD: 0.001},
        "max_restarts": -1, "max_task_retries": -1, "max_concurrency": 8,
    }  # fmt: skip
    controller = ray.remote(ControllerHost).options(**options).remote(wanted, _release(0))
    number = int(ray.get(controller.release.remote()).rpartition("+")[2])
    _request(controller.apply.remote(wanted, _release(number + replace)))
    return _wait(controller, waiting, lambda rows: all(row["settled"] for row in rows["sites"]))


def status(waiting: Waiting) -> int:
    """Show the status."""
    return _wait(_controller(waiting.address), waiting, lambda rows: all(_is_judged(row) for row in rows["sites"]))


def drain(node: str, waiting: Waiting) -> int:
    """Move each site from a node."""
    controller = _controller(waiting.address)
    _request(controller.drain.remote(node))
    return _wait(controller, waiting, lambda rows: not any(of["sites"] for of in rows["nodes"] if of["node"] == node))


def move(site: str, node: str | None, waiting: Waiting) -> int:
    """Move a site to another node."""
    controller = _controller(waiting.address)
    _request(controller.move.remote(site, node))
    return _wait(controller, waiting, lambda rows: all(of["settled"] for of in rows["sites"] if of["site"] == site))


def down(waiting: Waiting) -> int:
    """Stop all services and the controller."""
    controller, until_s = _controller(waiting.address), time.monotonic() + waiting.wait_s
    while not ray.get(controller.stop.remote()):
        if time.monotonic() > until_s:
            return 1
        time.sleep(_POLL_S)
    ray.kill(controller)
    return 0


def _connect(address: str) -> None:
    try:
        ray.init(address=address, namespace=NAMESPACE, log_to_driver=False, logging_level=logging.ERROR)
    except (ConnectionError, ValueError, RuntimeError) as error:
        reason = str(error).partition("\n")[0].partition(". ")[0]
        raise UserError(f"no Ray cluster at {address}: {reason}; start one with `ray start --head`") from None


def _controller(address: str) -> Any:  # noqa: ANN401 - the handle of an actor
    _connect(address)
    try:
        return ray.get_actor(_CONTROLLER)
    except ValueError:
        raise UserError("no fleet in this cluster: start one with `headway fleet up --config FILE`") from None


def _release(number: int) -> str:
    """Return the release that is wanted: the version, and how often all services were to be replaced."""
    return f"{version()}+{number}"


def _request(answer: Any) -> None:  # noqa: ANN401 - a reference of Ray
    problem = ray.get(answer)
    if problem is not None:
        raise UserError(problem)


def _is_judged(row: dict[str, Any]) -> bool:
    return row["state"] in {"judged", "moving"}


def _wait(controller: Any, waiting: Waiting, is_done: Callable[[dict[str, Any]], bool]) -> int:  # noqa: ANN401
    """Wait until it is done, show the status, and return the exit status."""
    until_s = time.monotonic() + waiting.wait_s
    while not (done := is_done(rows := ray.get(controller.status.remote()))) and time.monotonic() < until_s:
        time.sleep(_POLL_S)
    if waiting.as_json:
        sys.stdout.write(json.dumps(rows) + "\n")
    else:
        _show(rows)
    return 0 if done else 1


def _show(rows: dict[str, Any]) -> None:
    console = Console(highlight=False)
    for name, columns in _COLUMNS.items():
        table = Table(*columns, box=None, pad_edge=False)
        for row in rows[name]:
            table.add_row(*(_cell(row[column]) for column in columns))
        console.print(table)


def _cell(value: object) -> str:
    match value:
        case None:
            return ""
        case list():
            return " ".join(map(str, value))
        case float():
            return f"{value:g}"
        case _:
            return str(value)
