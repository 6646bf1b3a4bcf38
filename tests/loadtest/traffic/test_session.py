"""A service under test is the service that an operator starts."""

import os
import subprocess
import sys

import pytest


def threads_of_zenoh(module: str) -> str:
    """Return what `module` asks of zenoh in a process of its own, where nobody has asked before."""
    said = f"import os, {module}; print(os.environ['ZENOH_RUNTIME'])"
    environment = {name: value for name, value in os.environ.items() if name != "ZENOH_RUNTIME"}
    ended = subprocess.run(
        [sys.executable, "-c", said], check=True, env=environment, stdout=subprocess.PIPE, text=True, timeout=60
    )
    return ended.stdout


@pytest.mark.parametrize("first", ["headway_loadtest.traffic.session", "headway.cli.run.loadtest"])
def test_a_service_inherits_from_the_generator_what_it_would_ask_for_itself(first) -> None:
    assert threads_of_zenoh(first) == threads_of_zenoh("headway.edge.transport.zenoh_bus")
