"""The operations guide tells of everything an operator can meet, and of nothing else; its examples run."""

import json
import re
import socket
from collections.abc import Iterator
from queue import SimpleQueue

import pytest
import typer
import yaml
import zenoh
from deploy.manifest import ROOT
from sim.until import until

from headway.cli.app import app
from headway.core.types.outcome import Outcome
from headway.dashboard.app import create_app
from headway.dashboard.broadcast import Broadcaster
from headway.dashboard.view_state import ViewState
from headway.edge.clock import SystemClock
from headway.edge.storage.journal import Reason
from headway.edge.telemetry.metrics import TABLE
from headway.edge.transport.receive_queue import ReceiveQueue
from headway.edge.transport.zenoh_bus import ZenohBus
from headway.edge.transport.zenoh_config import BusConfig
from headway.settings import Settings, allowed
from headway_schemas import Event, Kind, Phase, Sensor, encodings
from headway_schemas.keys import Keys
from headway_schemas.query import EVENTS, AlertsQuery
from headway_schemas.state import Standing

GUIDE = (ROOT / "docs" / "OPERATIONS.md").read_text()
RULES = [
    rule["alert"]
    for group in yaml.safe_load((ROOT / "deploy/prometheus/headway.rules.yml").read_text())["groups"]
    for rule in group["rules"]
]
_OF_THE_MACHINE = {"instance": "the host's name", "state_dir": "of the system", "snapshot_dir": "of the system"}
_IDENTIFIER = "1 to 64 of letters, digits, `_ . ~ -`"
_SPELT = {
    "site": _IDENTIFIER,
    "instance": _IDENTIFIER,
    "prefix": "identifiers joined by `/`",
    "connect": "endpoints",
    "listen": "endpoints",
}


def section(title: str) -> str:
    """Return what stands between a heading of the second level and the next."""
    return GUIDE.partition(f"\n## {title}\n")[2].partition("\n## ")[0]


def rows(title: str) -> list[list[str]]:
    """Return the cells of the tables of a section, without their heads."""
    lines = [line for line in section(title).splitlines() if line.startswith("|")]
    cells = [[cell.strip() for cell in line.strip("|").split(" | ")] for line in lines]
    return [
        row for row, below in zip(cells, [*cells[1:], [""]], strict=True) if not {row[0][:3], below[0][:3]} & {"---"}
    ]


def names(title: str) -> list[str]:
    return [row[0].strip("`") for row in rows(title)]


def setting_row(name: str) -> str:
    field = Settings.model_fields[name]
    default = _OF_THE_MACHINE.get(name) or f"`{json.dumps(field.default, default=str)}`"
    return f"| `{name}` | {default} | {_SPELT.get(name) or allowed(name)} | {field.description} |"


def metric_row(name: str) -> str:
    [metric] = [metric for metric in TABLE if metric.name == name]
    labels = ", ".join(f"`{label}`" for label in metric.labels)
    return f"| `{metric.name}` | {metric.type} | {labels} | {metric.help} |"


@pytest.mark.parametrize("name", Settings.model_fields)
def test_a_setting_is_told_as_it_is(name: str) -> None:
    assert setting_row(name) in section("Settings").splitlines()


@pytest.mark.parametrize("name", [metric.name for metric in TABLE])
def test_a_metric_is_told_as_it_is(name: str) -> None:
    assert metric_row(name) in section("Metrics").splitlines()


@pytest.mark.parametrize(
    ("title", "there"),
    [
        ("Settings", list(Settings.model_fields)),
        ("Metrics", [metric.name for metric in TABLE]),
        ("What becomes of a record", [outcome.label for outcome in Outcome]),
        ("What is not in the journal", list(Reason)),
        ("What an event says", list(Kind)),
    ],
)
def test_a_table_tells_of_all_there_is_and_of_nothing_else(title: str, there: list[str]) -> None:
    assert sorted(names(title)) == sorted(there)


def test_every_reason_for_not_telling_is_explained() -> None:
    config = BusConfig(
        instance="i", mode="peer", connect=(), listen=(), options=None,
        connect_timeout_s=1.0, block_timeout_s=1.0, alert_limit=1, payload_max_bytes=1,
    )  # fmt: skip
    bus = ZenohBus(config, Keys("v2x", "s"), SystemClock(), ReceiveQueue(1, 1, 1, len))
    dropped = set(bus.dropped)
    bus.close()
    assert set(names("What is not published")) == dropped | {"rejected_copy_rate"}


def test_every_rule_has_what_to_do() -> None:
    text = section("When an alert fires")
    assert re.findall(r"^### (\w+)$", text, re.MULTILINE) == RULES
    for part in text.split("\n### ")[1:]:
        assert "**Means**" in part
        assert "**Do**" in part


def test_every_topic_is_told_with_its_encoding() -> None:
    keys = Keys("v2x", "<site>".strip("<>"))
    documented = {row[0].strip("`").replace("<site>", "site"): row[2].strip("`") for row in rows("Topics")}
    assert documented == {
        keys.every_alert.replace("**", "<kind>/<suspect>"): encodings.EVENT_JSON,
        keys.every_pair_state.replace("*", "<follower>"): encodings.PAIR_STATE_JSON,
        keys.every_quality.replace("*", "<vehicle>"): encodings.SENSOR_QUALITY_JSON,
        keys.every_rejected.replace("*", "<reason>"): encodings.REJECTED_JSON,
        keys.every_health.replace("*", "<instance>"): encodings.HEALTH_JSON,
        keys.every_handled.replace("*", "<vehicle>"): encodings.HANDLING_JSON,
        keys.every_handover.replace("*/*", "<origin>/<vehicle>"): encodings.VEHICLE_STATE,
        keys.handling: encodings.HANDLINGS_JSON,
        keys.alerts: encodings.EVENTS_JSON,
        keys.pairs: encodings.PAIR_STATES_JSON,
        keys.every_liveliness.replace("*", "<instance>"): "",
        keys.every_epoch.replace("*/*", "<epoch>/<instance>"): "",
        keys.every_bsm.replace("**", "<sender>"): encodings.BSM_MSGPACK,
    }


def test_words_of_the_wire_are_those_of_the_guide() -> None:
    text = section("For authors of dashboards")
    for words in (Phase, Standing, AlertsQuery.model_fields):
        for word in words:
            assert f"`{word}`" in text


def test_the_pages_that_the_guide_names_are_served() -> None:
    documented = set(re.findall(r"`GET (/\w*(?:/\{\w+\})?)`", section("For authors of dashboards")))

    class NoFeed:
        """Never started: routes are all that is asked for."""

    served = {getattr(route, "path", "") for route in create_app(Broadcaster(NoFeed(), ("s",))).routes}  # type: ignore[arg-type]
    assert documented
    assert documented <= served
    assert set(ViewState().delta(0)) <= set(re.findall(r"`(\w+)`", section("For authors of dashboards")))


def test_the_commands_that_the_guide_names_exist() -> None:
    documented = {tuple(words.split()[1:]) for words in re.findall(r"`(headway [a-z]+(?: [a-z]+)?)", GUIDE)}
    groups = typer.main.get_command(app).commands  # type: ignore[attr-defined]  # a group, which typer calls a command
    for command, *of_command in documented:
        assert command in groups
        assert set(of_command) <= set(getattr(groups[command], "commands", of_command))


def test_links_lead_somewhere() -> None:
    headings = re.findall(r"^#+ (.+)$", GUIDE, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", heading).lower().replace(" ", "-") for heading in headings}
    for target in re.findall(r"\]\(([^)]+)\)", GUIDE):
        file, _, anchor = target.partition("#")
        assert not file or (ROOT / "docs" / file).exists(), target
        assert file or anchor in anchors, target


def test_files_that_the_guide_names_exist() -> None:
    for name in re.findall(r"`((?:deploy|docker|docs|schemas|tests)/[\w./-]+)`", GUIDE):
        assert (ROOT / name).exists(), name


@pytest.fixture
def router() -> Iterator[str]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        endpoint = f"tcp/127.0.0.1:{probe.getsockname()[1]}"
    options = (ROOT / "deploy/zenoh/trial.json5").read_text().replace("tcp/[::]:7447", endpoint)
    with zenoh.open(zenoh.Config.from_json5(options)):
        yield endpoint


def event(suspect: str) -> Event:
    return Event(
        event_id="e", phase=Phase.ONSET, kind=Kind.BIAS, sensor=Sensor.LOCATION, suspect=suspect, follower=suspect,
        site="local", t_us=1, detected_us=2, model="headway", config_hash="h", latency_us={},
    )  # fmt: skip


def test_the_example_in_python_shows_the_history_what_is_new_and_what_was_missed(
    router: str, capsys: pytest.CaptureFixture[str]
) -> None:
    [example] = re.findall(r"```python\n(.*?)```", GUIDE, re.DOTALL)
    keys, service = Keys("v2x", "local"), zenoh.Config()
    service.insert_json5("mode", '"client"')
    service.insert_json5("connect/endpoints", json.dumps([router]))
    shown: list[str] = []
    parameters: list[str] = []
    with zenoh.open(service) as session:

        def answer(query: zenoh.Query) -> None:
            parameters.append(str(query.parameters))
            name = "missed" if "after_sequence" in parameters[-1] else "old"
            query.reply(keys.alerts, EVENTS.dump_json([event(name)]))
            query.drop()

        def published(sequence: int) -> bool:
            update = event("new").model_copy(update={"instance": "i", "sequence": sequence})
            session.put(keys.alert("bias", "new"), update.model_dump_json())
            shown.append(capsys.readouterr().out)
            return "new" in "".join(shown)

        def wait(missed: SimpleQueue[str]) -> str:
            if len(parameters) > 1:
                return ""
            until(lambda: published(7))
            published(9)
            return missed.get(timeout=60.0)

        asked = session.declare_queryable(keys.alerts, answer)
        assert "tcp/127.0.0.1:7447" in example
        example = example.replace("tcp/127.0.0.1:7447", router).replace("missed.get()", "wait(missed)")
        exec(compile(example, "example", "exec"), {"wait": wait})
        asked.undeclare()
    lines = [line.split()[2] for line in ("".join(shown) + capsys.readouterr().out).splitlines()]
    assert (lines[0], lines[1], lines[-1]) == ("old", "new", "missed")
    assert parameters[1:] == ["instance=i;after_sequence=7"]
