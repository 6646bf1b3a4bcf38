"""A peer as the load test sees a service: its reports and the figures of its processes, as health on zenoh."""

import json
import os
import re
import socket
import subprocess
import threading
import time
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Self

from bench.services import SITE
from sim.loopback import free_endpoint, session

from headway_loadtest.measure.result import INTENDED
from headway_schemas import Keys

READY_S, EVERY_S = 120.0, 0.5
_TICKS = os.sysconf("SC_CLK_TCK")


class PeerError(RuntimeError):
    """A peer does not run: the reason in one line."""


class Bridge:
    """Runs the command of a peer with the address of its reports behind it, and publishes its health."""

    def __init__(self, command: Sequence[str], folder: Path) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.settimeout(EVERY_S)
        self._reports: dict[str, dict[str, Any]] = {}
        self.endpoint = free_endpoint()
        self._log = folder / "log"
        self._done = threading.Event()
        address = f"127.0.0.1:{self._socket.getsockname()[1]}"
        apart = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
        with self._log.open("wb") as log:
            self._process = subprocess.Popen(
                [*command, address], cwd=folder, stdout=log, stderr=log, env=apart, start_new_session=True
            )
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def wait(self, judged: int) -> bool:
        """Wait a second at most for so many judged messages; raises `PeerError` where the peer has ended."""
        if self._process.poll() is not None:
            lines = self._log.read_text(encoding="utf-8", errors="replace").split("\n")
            raise PeerError(next((line for line in reversed(lines) if re.search("[A-Za-z]", line)), "ended"))
        deadline_s = time.monotonic() + 1.0
        while (is_there := self._judged() >= judged) is False and time.monotonic() < deadline_s:
            time.sleep(0.05)
        return is_there

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        for pid in descendants(self._process.pid):
            try:
                os.kill(pid, 9)
            except ProcessLookupError:
                continue
        self._process.wait()
        self._done.set()
        self._thread.join()
        self._socket.close()

    def _judged(self) -> int:
        return sum(report["judged"] for report in self._reports.copy().values())

    def _run(self) -> None:
        health_s, cpu_s = 0.0, 0.0
        with session("peer", listen=(self.endpoint,)) as bus:
            while not self._done.is_set():
                try:
                    report = json.loads(self._socket.recv(65_536))
                    self._reports[report["instance"]] = report
                except TimeoutError:
                    pass
                if time.monotonic() - health_s >= EVERY_S:
                    health_s, pids = time.monotonic(), descendants(self._process.pid)
                    cpu_s = max(cpu_s, sum(map(_cpu_s, pids)))
                    bus.put(Keys("v2x", SITE).health("peer"), self._health(cpu_s, sum(map(_rss_mb, pids))))

    def _health(self, cpu_s: float, rss_mb: float) -> str:
        buckets: Counter[int] = Counter()
        for report in self._reports.values():
            buckets.update(dict(report["buckets"]))
        counters = {"scored": self._judged(), "warming": 0, "rejected": {}, "lost": {}, "queue_depth": 0}
        figures = {"instance": "peer", "cpu_s": cpu_s, "rss_mb": rss_mb}
        return json.dumps(counters | figures | {"histograms_us": {INTENDED: list(buckets.items())}})


def descendants(pid: int) -> list[int]:
    """Return a process and all that come from it."""
    parents = {int(path.name): _stat(int(path.name))[1] for path in Path("/proc").iterdir() if path.name.isdecimal()}
    found = [pid]
    for one in found:
        found += [child for child, parent in parents.items() if parent == str(one)]
    return found


def _stat(pid: int) -> list[str]:
    """Return the fields of a process from its state on; zeros where it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    except OSError:
        return ["0"] * 30


def _cpu_s(pid: int) -> float:
    return sum(map(int, _stat(pid)[11:15])) / _TICKS


def _rss_mb(pid: int) -> float:
    return int(_stat(pid)[21]) * os.sysconf("SC_PAGE_SIZE") / 1e6
