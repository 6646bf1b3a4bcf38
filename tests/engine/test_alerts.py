"""Prometheus and Alertmanager with the files of `deploy`: what reaches a receiver of a faulty vehicle, and of a service
that dies. Only addresses are replaced.
"""

import json
import os
import random
import shutil
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx
import pytest
from browser.serving import dashboard, receiver
from e2e.serving import KEYS, Service, without_headway
from engine.debian import ROOT
from fake_service import free_port
from made_recording import northbound
from sim.until import until

pytestmark = pytest.mark.engine

DEPLOY = ROOT / "deploy"
WATCHED = {"HeadwayVehicleFaulty", "HeadwayDown"}
"""A machine that is busy with other work raises others, such as HeadwayShedding."""
NOTIFIED_S = 240.0
"""The rules wait for half a minute or a minute, and Prometheus and Alertmanager gather."""


@contextmanager
def running(folder: Path, *command: str, **environment: str) -> Iterator[None]:
    """Run a process whose output goes to a file."""
    program = shutil.which(command[0])
    if program is None:
        pytest.skip(f"needs {command[0]} (Debian: apt-get install prometheus prometheus-alertmanager)")
    name = Path(command[0]).name
    with (
        (folder / f"{name}.log").open("wb") as log,
        subprocess.Popen([program, *command[1:]], stdout=log, stderr=log, env=os.environ | environment) as process,
    ):
        try:
            yield
        finally:
            process.terminate()


@contextmanager
def alertmanager(folder: Path, webhook: str) -> Iterator[str]:
    config = (DEPLOY / "alertmanager" / "alertmanager.yml").read_text()
    assert "http://headway.example/alerts" in config
    (folder / "alertmanager.yml").write_text(config.replace("http://headway.example/alerts", webhook))
    address = f"127.0.0.1:{free_port()}"
    options = (f"--config.file={folder}/alertmanager.yml", f"--storage.path={folder}/alertmanager")
    with running(
        folder, "prometheus-alertmanager", *options, f"--web.listen-address={address}", "--cluster.listen-address="
    ):
        until(lambda: is_ready(address))
        yield address


@contextmanager
def prometheus(folder: Path, service: str, alertmanager: str) -> Iterator[str]:
    config = (DEPLOY / "prometheus" / "prometheus.yml").read_text()
    for ours, here in (("service:9464", service), ("alertmanager:9093", alertmanager)):
        assert ours in config
        config = config.replace(ours, here)
    (folder / "prometheus.yml").write_text(config)
    shutil.copy(DEPLOY / "prometheus" / "headway.rules.yml", folder)
    address = f"127.0.0.1:{free_port()}"
    options = (f"--config.file={folder}/prometheus.yml", f"--storage.tsdb.path={folder}/prometheus")
    with running(folder, "prometheus", *options, f"--web.listen-address={address}"):
        until(lambda: is_ready(address))
        yield address


def is_ready(address: str) -> bool:
    try:
        return httpx.get(f"http://{address}/-/ready").status_code == 200
    except httpx.TransportError:
        return False


def eventually(holds: Callable[[], object]) -> None:
    """Return once `holds` is true, looked at twice a second."""
    give_up = time.monotonic() + NOTIFIED_S
    while not holds():
        assert time.monotonic() < give_up, "not in time"
        time.sleep(0.5)


def states(address: str) -> dict[tuple[str, str | None], str]:
    """Return the state of each watched alert that Alertmanager has, by its name and vehicle."""
    alerts = httpx.get(f"http://{address}/api/v2/alerts").json()
    return {
        (name, one["labels"].get("vehicle")): one["status"]["state"]
        for one in alerts
        if (name := one["labels"]["alertname"]) in WATCHED
    }


def notified(bodies: list[dict[str, Any]]) -> list[tuple[str, str, str | None]]:
    """Return status, name and vehicle of each watched alert in each notification, in order."""
    return [
        (alert["status"], alert["labels"]["alertname"], alert["labels"].get("vehicle"))
        for body in bodies
        for alert in body["alerts"]
        if alert["labels"]["alertname"] in WATCHED
    ]


def test_a_faulty_vehicle_is_one_notification_and_its_end_another_and_so_is_a_dead_service(tmp_path: Path) -> None:
    records, _ = northbound(lambda _s, rng: (rng.gauss(0.0, 3.0), 0.0), random.Random(1), end=1_800)
    recording = tmp_path / "drive.jsonl"
    recording.write_text("".join(json.dumps(record) + "\n" for record in records))
    running_service = Service(tmp_path / "service", {"HEADWAY_ALARM_BUDGET_PER_HOUR": "0.001"})
    replay = (sys.executable, "-m", "headway", "replay", str(recording), f"--site={KEYS.site}")
    with receiver() as (webhook, bodies), alertmanager(tmp_path, webhook) as alerts:
        try:
            with (
                prometheus(tmp_path, running_service.url.removeprefix("http://"), alerts),
                dashboard([running_service.endpoint], (KEYS.site,), f"--alertmanager=http://{alerts}"),
            ):
                with subprocess.Popen(
                    [*replay, f"--connect={running_service.endpoint}"], env=without_headway(), stderr=subprocess.DEVNULL
                ) as driving:
                    eventually(lambda: ("HeadwayVehicleFaulty", None) in states(alerts))
                    assert states(alerts) == {
                        ("HeadwayVehicleFaulty", "blue"): "active",
                        ("HeadwayVehicleFaulty", None): "suppressed",
                    }
                    assert notified(bodies) == [("firing", "HeadwayVehicleFaulty", "blue")]
                    driving.wait()
                eventually(lambda: len(notified(bodies)) == 2)
                assert notified(bodies)[1:] == [("resolved", "HeadwayVehicleFaulty", "blue")]
                running_service.kill()
                eventually(lambda: len(notified(bodies)) == 3)
                assert notified(bodies)[2:] == [("firing", "HeadwayDown", None)]
        finally:
            running_service.kill()
