"""A fleet on a Ray cluster of this machine: its nodes and services as processes, and what the bus shows of them."""

import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import zenoh
from e2e.serving import without_headway
from faults.harness.network import Network
from sim.loopback import session

from headway_schemas import Event, Health

HERE = Path(__file__).parent
ENVIRONMENT = {
    "RAY_USAGE_STATS_ENABLED": "0",
    "RAY_raylet_start_wait_time_s": "120",
    "RAY_worker_niceness": "0",  # as docs/howto/fleet.md advises
    "PYTHONWARNINGS": "ignore",
}


class Script:
    """A script of this folder, spoken to by lines; it ends when its standard input does."""

    def __init__(self, name: str, *arguments: str) -> None:
        self.popen = subprocess.Popen(
            [sys.executable, str(HERE / name), *arguments],
            env=without_headway() | ENVIRONMENT,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def write(self, line: str) -> None:
        assert self.popen.stdin is not None
        self.popen.stdin.write(line + "\n")
        self.popen.stdin.flush()

    def read(self) -> dict:
        """Return the next line that is JSON."""
        assert self.popen.stdout is not None
        while not (line := self.popen.stdout.readline()).startswith("{"):
            assert line, f"{self.popen.args} ended"
        return json.loads(line)

    def end(self) -> None:
        """End its input, and wait for its end."""
        assert self.popen.stdin is not None
        self.popen.stdin.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_error: object) -> None:
        self.end()
        try:
            self.popen.wait(30.0)
        except subprocess.TimeoutExpired:
            self.popen.kill()
            self.popen.wait()
        assert self.popen.stdout is not None
        self.popen.stdout.close()


def tree(pid: int) -> list[int]:
    """Return a process and all that it started."""
    children = defaultdict(list)
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            children[int(stat.read_text().rpartition(")")[2].split()[1])].append(int(stat.parent.name))
        except OSError:
            continue
    found = [pid]
    for parent in found:
        found += children[parent]
    return found


def send(pids: Sequence[int], number: signal.Signals) -> None:
    for pid in pids:
        try:
            os.kill(pid, number)
        except ProcessLookupError:
            continue


@dataclass(frozen=True)
class ServiceProcess:
    """A process of `headway serve` that the fleet started."""

    pid: int
    host_pid: int
    site: str

    def kill(self) -> None:
        send([self.pid], signal.SIGKILL)


def services(state_dir: Path) -> list[ServiceProcess]:
    """Return the services of a fleet, oldest first: those that have the journal of a site open."""
    found = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if b"--standby" not in (folder / "cmdline").read_bytes().split(b"\0"):
                continue
            files = {file.readlink() for file in (folder / "fd").iterdir()}
            parent = int((folder / "stat").read_text().rpartition(")")[2].split()[1])
        except OSError:
            continue
        sites = {
            file.parent.name for file in files if file.name == "journal.sqlite" and file.parent.parent == state_dir
        }
        found += [ServiceProcess(int(folder.name), parent, site) for site in sites]
    return sorted(found, key=lambda service: service.pid)


def alive(pids: Iterable[int]) -> list[int]:
    """Return those of some processes that have not ended."""
    found = []
    for pid in pids:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            continue
        found += [pid] if state != "Z" else []
    return found


class RayNodes:
    """The cluster and its nodes."""

    def __init__(self) -> None:
        self.script = Script("ray_process.py")
        self.address = self.script.read()["address"]
        self.raylets: dict[str, int] = {}

    def add(self, name: str) -> None:
        self.script.write(name)
        self.raylets[name] = self.script.read()["pid"]

    def fleet(self, *arguments: str, check: bool = True) -> subprocess.CompletedProcess[str]:
        """Run `headway fleet` with the address of the cluster."""
        ended = subprocess.run(
            [sys.executable, "-m", "headway", "fleet", *arguments, "--address", self.address],
            check=False,
            env=without_headway() | ENVIRONMENT,
            capture_output=True,
            text=True,
        )
        assert not check or ended.returncode == 0, ended.stdout + ended.stderr
        return ended

    def status(self) -> dict:
        return json.loads(self.fleet("status", "--json", check=False).stdout)


class SeparateNode:
    """A node of the cluster in a network of its own."""

    def __init__(self, name: str, address: str, cpus: int) -> None:
        self.network = Network(7)
        start = (
            f"{sys.executable} -m ray.scripts.scripts start --address {address} --node-name {name} --num-cpus {cpus}"
            f" --node-ip-address {self.network.other} --object-store-memory {80 << 20} --block"
        )
        self._popen = subprocess.Popen(
            [*self.network.inside, *start.split()], env=without_headway() | ENVIRONMENT, stdout=subprocess.DEVNULL
        )

    @property
    def raylet(self) -> int | None:
        """Process id of the raylet, None before it runs."""
        for pid in tree(self._popen.pid):
            if (Path("/proc") / str(pid) / "comm").read_text().strip() == "raylet":
                return pid
        return None

    def close(self) -> None:
        """End all of it."""
        send(tree(self._popen.pid), signal.SIGKILL)
        self._popen.wait()
        self.network.close()


@dataclass(frozen=True)
class Report:
    """A health report and when it came."""

    at_s: float
    health: Health

    @property
    def judged(self) -> int:
        return self.health.scored + self.health.warming

    @property
    def accounted(self) -> int:
        return self.judged + sum(self.health.rejected.values()) + self.health.sequence_gap_messages


class Observer:
    """Alerts and health reports of all sites, in the order received."""

    def __init__(self, endpoint: str) -> None:
        self._session = session("client", connect=(endpoint,))
        self._lock = threading.Lock()
        self.reports: defaultdict[str, list[Report]] = defaultdict(list)
        self.alerts: defaultdict[str, list[Event]] = defaultdict(list)
        self.epochs: defaultdict[str, list[int]] = defaultdict(list)
        """Of each alert and report."""
        self._session.declare_subscriber("v2x/*/health/*", self._on_health)
        self._session.declare_subscriber("v2x/*/alert/**", self._on_alert)

    def _on_health(self, sample: zenoh.Sample) -> None:
        health = Health.model_validate_json(sample.payload.to_bytes())
        with self._lock:
            self.reports[health.site].append(Report(time.monotonic(), health))
            self.epochs[health.site].append(health.epoch or 0)

    def _on_alert(self, sample: zenoh.Sample) -> None:
        alert = Event.model_validate_json(sample.payload.to_bytes())
        with self._lock:
            self.alerts[alert.site].append(alert)
            self.epochs[alert.site].append(alert.epoch or 0)

    def newest(self, site: str) -> Report | None:
        reports = self.reports[site]
        return reports[-1] if reports else None

    def epoch(self, site: str) -> int:
        return max(self.epochs[site], default=0)

    def judged_again(self, site: str, epoch: int) -> Report | None:
        """Return the first report of a higher epoch that has judged records."""
        later = (of for of in self.reports[site] if (of.health.epoch or 0) > epoch and of.judged)
        return next(later, None)

    def unjudged_s(self, site: str, since_s: float) -> float:
        """Return the longest time without a newly judged record, as the reports show it."""
        longest_s, last = 0.0, None
        for of in self.reports[site]:
            if last is not None and (of.health.epoch, of.judged) != (last.health.epoch, last.judged):
                if of.at_s > since_s:
                    longest_s = max(longest_s, of.at_s - last.at_s)
                last = of if of.judged else last
            last = last or of
        return longest_s

    def ends(self, site: str) -> list[Report]:
        """Return the last report of each epoch."""
        return list({of.health.epoch: of for of in self.reports[site]}.values())

    def close(self) -> None:
        self._session.close()
