"""What was said survives the process that said it: a client that comes late, and a service that is started again."""

import json
import subprocess
import sys
from pathlib import Path

import pytest
import zenoh
from e2e.serving import KEYS, Service, drive, without_headway
from edge.storage.updates import stored
from sim.loopback import session
from sim.until import until

from headway_schemas import Event
from headway_schemas.event import Phase
from headway_schemas.query import EVENTS, AlertsQuery


@pytest.fixture
def started(tmp_path: Path):
    """Starts a service whose state is in `tmp_path`; the one before it must have ended."""
    services: list[Service] = []

    def start() -> Service:
        services.append(Service(tmp_path, {"HEADWAY_STATE_DIR": str(tmp_path / "state")}))
        return services[-1]

    yield start
    for service in services:
        service.process.kill()
        service.process.wait(10.0)


def asked(client: zenoh.Session, query: AlertsQuery) -> list[Event]:
    [reply] = list(client.get(f"{KEYS.alerts}?{query.to_parameters()}", timeout=20.0))
    return EVENTS.validate_json(reply.ok.payload.to_bytes())


def explained(event_id: str, *options: str) -> dict:
    command = [sys.executable, "-m", "headway", "explain", event_id, "--site", KEYS.site, "--json", *options]
    done = subprocess.run(command, env=without_headway(), capture_output=True, text=True, check=True, timeout=120.0)
    return json.loads(done.stdout)


def test_history_survives_a_restart_and_vehicles_are_known_again(started, tmp_path: Path) -> None:
    service = started()
    received: list[Event] = []
    car = session("client", connect=(service.endpoint,))
    car.declare_subscriber(
        KEYS.every_alert, lambda sample: received.append(Event.model_validate_json(sample.payload.to_bytes()))
    )
    until(lambda: service.metric("headway_peers").get("") == 1)
    drive(car, readings=60, fault_from=40)
    until(lambda: received)
    late = session("client", connect=(service.endpoint,))
    until(lambda: asked(late, AlertsQuery(evidence=True)) == stored(received))
    onset = next(event for event in received if event.phase is Phase.ONSET)
    assert explained(onset.event_id, "--connect", service.endpoint)["same"]
    for client in (car, late):
        client.close()
    assert service.stop() == 0

    service = started()
    [loaded] = [line for line in service.log() if line["event"] == "snapshot loaded"]
    assert loaded["vehicles"] == service.metric("headway_vehicles")[""] == 2
    late = session("client", connect=(service.endpoint,))
    published = asked(late, AlertsQuery(phase=Phase.ONSET))
    assert onset.event_id in {event.event_id for event in published}
    late.close()
    assert explained(onset.event_id, "--journal", str(tmp_path / "state" / "journal.sqlite"))["same"]
    assert service.stop() == 0
