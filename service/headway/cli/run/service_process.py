"""The service in a process of its own, for the demo and the load test: started, waited for, and stopped in order."""

import os
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from headway.errors import UserError
from headway.settings import ENV_PREFIX

READY_S = 1_200.0
"""The first start of a model compiles its kernels, for many minutes if the machine is busy; later ones load them."""
STOP_S = 20.0
PREFIX = "v2x"
"""Of the keys of a service that runs here."""


@dataclass(frozen=True, slots=True)
class Child:
    """Where a service that runs is to be reached."""

    endpoint: str
    """On zenoh."""
    metrics_url: str


@contextmanager
def scraping(url: str, every_s: float) -> Iterator[None]:
    """Read the metrics all the while, as Prometheus would."""
    done = threading.Event()

    def scrape() -> None:
        while not done.wait(every_s):
            with suppress(OSError), urllib.request.urlopen(url, timeout=every_s) as answer:  # noqa: S310
                answer.read()

    thread = threading.Thread(target=scrape, name="scrape", daemon=True)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


@contextmanager
def running_service(settings: Mapping[str, object], config: Path | None = None) -> Iterator[Child]:
    """Run `headway serve` on free loopback ports; say where once it is ready, stop it at the end.

    It has the settings of `config` and of the environment, with `settings` over both, on a bus of its own.

    Raises
    ------
    UserError
        It ended, or was not ready in time; its last words are in the message.
    """
    bus, http = _free_ports(2)
    endpoint = f"tcp/127.0.0.1:{bus}"
    own: dict[str, object] = {"prefix": PREFIX, "mode": "peer", "connect": "", "listen": endpoint}
    own |= {
        "zenoh_config": "",
        "http_host": "127.0.0.1",
        "http_port": http,
        "log_level": "warning",
        "state_dir": "",
        **settings,
    }
    environment = os.environ | {ENV_PREFIX + name.upper(): str(value) for name, value in own.items()}
    command = [sys.executable, "-m", "headway", "serve", *(["--config", str(config)] if config else [])]
    with tempfile.TemporaryFile("w+") as words:
        process = subprocess.Popen(command, env=environment, stderr=words, stdout=subprocess.DEVNULL)  # noqa: S603
        try:
            _wait_until_ready(process, f"http://127.0.0.1:{http}/readyz", words)
            yield Child(endpoint, f"http://127.0.0.1:{http}/metrics")
        finally:
            process.send_signal(signal.SIGTERM)
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def _wait_until_ready(process: subprocess.Popen[bytes], url: str, words: IO[str]) -> None:
    deadline_s = time.monotonic() + READY_S
    while time.monotonic() < deadline_s:
        if process.poll() is not None:
            raise UserError(f"the service ended before it was ready: {_last_line(words)}")
        try:
            with urllib.request.urlopen(url, timeout=1.0):  # noqa: S310
                return
        except OSError:  # not there yet, or starting anew
            time.sleep(0.1)
    raise UserError(f"the service was not ready within {READY_S:.0f} s: {_last_line(words)}")


def _last_line(words: IO[str]) -> str:
    words.seek(0)
    lines = words.read().strip().splitlines()
    return lines[-1] if lines else "it said nothing"


def _free_ports(count: int) -> list[int]:
    sockets = [socket.socket() for _ in range(count)]
    try:
        for one in sockets:
            one.bind(("127.0.0.1", 0))
        return [one.getsockname()[1] for one in sockets]
    finally:
        for one in sockets:
            one.close()
