"""Faults over real zenoh with real processes. Each test is a row of the table that is printed at the end."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from e2e.serving import KEYS, Service
from faults.harness.processes import Router
from sim.loopback import free_endpoint, session
from sim.until import until

from headway_schemas import Event
from headway_schemas.query import EVENTS, AlertsQuery

DEPLOYED = Path(__file__).resolve().parents[2] / "deploy" / "zenoh"
_ROWS = pytest.StashKey[list[tuple[str, str, str]]]()


def pytest_configure(config: pytest.Config) -> None:
    config.stash[_ROWS] = []


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker("faults")


@pytest.fixture
def measured(request: pytest.FixtureRequest):
    """Notes a row of the table: what was done, what came of it, what it must be."""

    def note(reason: str, got: str, must: str) -> None:
        request.config.stash[_ROWS].append((reason, got, must))

    return note


@pytest.fixture
def router() -> Iterator[Router]:
    """The router of `deploy/zenoh/trial.json5`."""
    with Router(free_endpoint(), DEPLOYED / "trial.json5") as router:
        until(lambda: router.ready)
        yield router


@pytest.fixture
def start(tmp_path: Path) -> Iterator:
    """Starts services, each with a folder of its own for its log, and one for the state of all; kills them at the end.

    `start(router=..., **settings)`: a client of the router, or a peer that listens.
    """
    services: list[Service] = []

    def starting(router: Router | None = None, **settings: str) -> Service:
        more = {f"HEADWAY_{name.upper()}": value for name, value in settings.items()}
        more = {"HEADWAY_STATE_DIR": str(tmp_path / "state"), "HEADWAY_VEHICLE_CAPACITY": "1000"} | more
        if router is not None:
            more |= {"HEADWAY_MODE": "client", "HEADWAY_CONNECT": router.endpoint, "HEADWAY_LISTEN": ""}
        endpoint = router.endpoint if router else None
        services.append(Service(tmp_path / f"service-{len(services)}", more, endpoint))
        return services[-1]

    yield starting
    for service in services:
        service.kill()


@pytest.fixture
def history() -> Iterator:
    """Asks the service behind an endpoint for its history, as a dashboard does: `history(endpoint, **query)`."""
    sessions: dict = {}

    def ask(endpoint: str, **query: object) -> list[Event]:
        if endpoint not in sessions:
            sessions[endpoint] = session("client", connect=(endpoint,))
        selector = f"{KEYS.alerts}?{AlertsQuery(**{'limit': 1_000, **query}).to_parameters()}"
        replies = [reply.ok for reply in sessions[endpoint].get(selector, timeout=5.0)]
        return [event for ok in replies if ok for event in EVENTS.validate_json(ok.payload.to_bytes())]

    yield ask
    for client in sessions.values():
        client.close()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter, config: pytest.Config) -> None:
    rows = config.stash[_ROWS]
    if not rows:
        return
    terminalreporter.section("faults")
    for reason, got, must in [("fault", "measured", "must be"), *rows]:
        terminalreporter.write_line(f"{reason:<60} {got:<50} {must}")
