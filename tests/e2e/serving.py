"""`headway serve` in a process of its own, and vehicles that drive past it."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import httpx
import msgpack
import zenoh
from prometheus_client.parser import text_string_to_metric_families
from sim.loopback import free_endpoint
from sim.until import until

from headway_schemas import Keys
from headway_schemas.encodings import BSM_MSGPACK

KEYS = Keys("v2x", "e2e")


START_S = 300.0
"""The first start on a machine compiles the kernels."""


BLOCK = zenoh.CongestionControl.BLOCK


class Service:
    """The process and how to look at it from outside."""

    def __init__(self, folder: Path, more: dict[str, str] | None = None, endpoint: str | None = None) -> None:
        folder.mkdir(exist_ok=True)
        self.endpoint = endpoint or free_endpoint()
        self._log = folder / "log"
        settings = {
            "HEADWAY_SITE": KEYS.site,
            "HEADWAY_INSTANCE": "i",
            "HEADWAY_LISTEN": self.endpoint,
            "HEADWAY_HTTP_PORT": "0",
            "HEADWAY_VEHICLE_CAPACITY": "64",
            "HEADWAY_SENDER_RATE_HZ": "1000000",
            "HEADWAY_HEALTH_INTERVAL_S": "0.1",
        }
        with self._log.open("wb") as log:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "headway", "serve"], env=without_headway() | settings | (more or {}), stderr=log
            )
        try:
            until(self._is_ready, START_S)
        except BaseException:
            self.kill()
            raise

    def _is_ready(self) -> bool:
        """Whether it is, where it last said that it is to be asked: a start that compiles is followed by another."""
        ports = [line["http_port"] for line in self.log() if "http_port" in line]
        assert self.process.poll() is None, self._log.read_text(encoding="utf-8")
        if not ports:
            return False
        self.url = f"http://127.0.0.1:{ports[-1]}"
        try:
            return httpx.get(f"{self.url}/readyz").status_code == 200
        except httpx.TransportError:
            return False

    def log(self) -> list[dict]:
        return [json.loads(line) for line in self._log.read_text(encoding="utf-8").splitlines()]

    def metric(self, name: str) -> dict[str, float]:
        """Values by the labels' values, joined."""
        families = text_string_to_metric_families(httpx.get(f"{self.url}/metrics").text)
        return {
            " ".join(sample.labels.values()): sample.value
            for family in families
            for sample in family.samples
            if sample.name == name
        }

    def judged(self) -> int:
        """Records that it scored, or would have if their vehicle were warm."""
        outcomes = self.metric("headway_records_total")
        return round(outcomes["scored"] + outcomes["warming"])

    def said(self, event: str) -> list[dict]:
        """Lines of its log."""
        return [line for line in self.log() if line["event"].startswith(event)]

    def kill(self) -> None:
        self.process.kill()
        self.process.wait(10.0)

    def stop(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(30.0)


def without_headway() -> dict[str, str]:
    return {name: value for name, value in os.environ.items() if not name.upper().startswith("HEADWAY_")}


def drive(sender: zenoh.Session, readings: int, fault_from: int) -> int:
    """Send the last seconds of a leader and of a follower whose location lies by 20 m from some reading on; 10 Hz.

    They come apart by more than a slot, at whose end the follower's leader is searched for.
    """
    end_us = time.time_ns() // 1000
    for k in range(readings):
        time.sleep(0.015)
        t_us = end_us - (readings - 1 - k) * 100_000
        for name, behind_m in (("leader", 0.0), ("follower", 30.0)):
            offset_m = 20.0 if name == "follower" and k >= fault_from else 0.0
            lat = 42.0 + (1.5 * k - behind_m + offset_m) / 111_083.0
            record = [1, name, k % 128, t_us, lat, -83.0, 15.0, 0.0, None, None, None, 4.5]
            sender.put(KEYS.bsm(name), msgpack.packb(record), encoding=BSM_MSGPACK, congestion_control=BLOCK)
    return 2 * readings
