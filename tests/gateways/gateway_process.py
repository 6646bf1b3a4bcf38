"""A gateway in a process of its own."""

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def running(command: str) -> Iterator[None]:
    """Run a gateway as its users do."""
    process = subprocess.Popen([sys.executable, "-m", "headway", "gateway", *command.split(), "--http-port", "0"])
    try:
        yield
        process.terminate()
        assert process.wait(20.0) == 0
    finally:
        process.kill()
        process.wait()
