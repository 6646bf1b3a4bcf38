"""From the loop over the disk to the commands: what was said is found again and comes out the same, to the last bit."""

import csv
import json
from pathlib import Path

import polars as pl
import pytest
from edge.codec.messages import received, record
from edge.storage.updates import stored
from sim.faulty_platoon import LENGTH_M, NAMES, drive
from sim.memory_bus import MemoryQuery
from sim.rig import KEYS, Rig
from typer.testing import CliRunner

from headway.cli.app import app
from headway.core.engine import Engine
from headway.core.types.config import DetectorConfig
from headway.edge.codec.evidence import from_wire, parameters
from headway.edge.identity import Identity
from headway.edge.storage.persistence import JOURNAL_FILE
from headway.edge.transport.ports import Channel
from headway.errors import UserError
from headway.explain.compare import replayed, same
from headway.kernel_cache import core_digest
from headway_schemas import Event
from headway_schemas.event import Kind, Phase, Sensor
from headway_schemas.query import EVENTS

CONFIG = DetectorConfig(model="aekf", vehicle_capacity=8, warming_readings=20)
METRES_PER_DEGREE = 111_083.0
IDENTITY = Identity(
    site="s", instance="i", version="1", model="aekf", config_hash="c0ffee",
    parameters=parameters(CONFIG, "1", core_digest()),
)  # fmt: skip


def driven(folder: Path, seed: int = 1) -> Rig:
    """Let the loop hear the three cars, with a journal in `folder`, and stop."""
    rig = Rig(Engine(CONFIG), state_dir=folder, identity=IDENTITY)
    for now in drive(seed):
        while rig.clock.wall_us() < now.t_us + 5_000:
            rig.clock.sleep(0.005)
            rig.loop.iterate()
        for i, name in enumerate(NAMES):
            sent = record(
                name,
                t_us=now.t_us,
                msg_cnt=now.k % 128,
                lat=42.0 + now.x_m[i] / METRES_PER_DEGREE,
                lon=-83.0,
                speed_mps=now.v_mps[i],
                heading_deg=0.0,
                length_m=LENGTH_M,
                leader=[NAMES[i - 1], now.range_m[i]] if i else None,
            )
            now_us, now_ns = rig.clock.local_us(), rig.clock.monotonic_ns()
            rig.bus.deliver(received(sent, name)._replace(received_us=now_us, received_ns=now_ns))
        rig.loop.iterate()
    rig.loop.drain(1.0)
    assert rig.persistence is not None
    rig.persistence.close()
    return rig


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Event]]:
    """A drive's journal, and what was told on the bus."""
    folder = tmp_path_factory.mktemp("state")
    rig = driven(folder)
    return folder / JOURNAL_FILE, [Event.model_validate_json(payload) for _, payload in rig.bus.on(Channel.ALERT)]


def invoke(*args: object) -> tuple[int, str]:
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.exit_code, result.stdout


def test_the_onset_of_every_event_is_replayed_from_the_wire_bit_for_bit(
    run: tuple[Path, list[Event]], tmp_path: Path
) -> None:
    bus = driven(tmp_path, seed=2).bus
    published = [*run[1], *(Event.model_validate_json(payload) for _, payload in bus.on(Channel.ALERT))]
    events = [event for event in published if event.evidence is not None]
    assert [event.phase for event in events] == [Phase.ONSET] * len(events)
    assert len(events) >= 6
    assert {event.sensor is Sensor.LINK for event in events} == {True, False}
    for event in events:
        again = replayed(event)
        assert again.problem is None
        assert [number for number in again.numbers if not number.same] == []
        assert len(again.numbers) >= 11


def test_what_was_told_on_the_bus_is_what_the_journal_answers(run: tuple[Path, list[Event]], tmp_path: Path) -> None:
    journal, events = run
    later = Rig(Engine(CONFIG), state_dir=journal.parent, identity=IDENTITY)
    queries = [
        MemoryQuery(KEYS.alerts, {"limit": "1000", "evidence": "True"}),
        MemoryQuery(KEYS.alerts, {"limit": "0"}),
        MemoryQuery(KEYS.alerts, {"colour": "red"}),
        MemoryQuery(KEYS.alerts, {"event": "nobody-1"}),
    ]
    later.bus.queries.extend(queries)
    later.iterate(0.1)
    assert later.persistence is not None
    later.persistence.close()
    [answer] = queries[0].answers
    in_order = sorted(EVENTS.validate_json(answer), key=lambda event: event.detected_us)
    assert sorted(in_order, key=repr) == sorted(stored(events), key=repr)
    assert [event.detected_us for event in in_order] == sorted(event.detected_us for event in stored(events))
    assert queries[1].refusals == ["limit: Input should be greater than or equal to 1"]
    assert queries[2].refusals == ["colour: Extra inputs are not permitted"]
    assert queries[3].answers == [b"[]"]


@pytest.mark.parametrize("sensor", [Sensor.LOCATION, Sensor.LINK])
def test_the_command_shows_the_same_numbers_and_a_plot(
    run: tuple[Path, list[Event]], sensor: Sensor, tmp_path: Path
) -> None:
    journal, events = run
    event_id = next(event.event_id for event in events if event.sensor is sensor)
    picture = tmp_path / "event.png"
    status, out = invoke("explain", event_id, "--journal", journal, "--plot", picture, "--json")
    shown = json.loads(out)
    assert (status, shown["same"], shown["event_id"]) == (0, True, event_id)
    assert shown["updates"][0]["phase"] == "onset"
    onset = next(event for event in events if event.event_id == event_id)
    assert shown["updates"][0]["numbers"]["statistic"] == {"stored": onset.statistic, "recomputed": onset.statistic}
    assert picture.read_bytes().startswith(b"\x89PNG")
    status, out = invoke("explain", event_id, "--journal", journal)
    assert status == 0
    assert "equal to the last bit" in out


def test_a_verdict_that_does_not_come_out_again_is_said_so(run: tuple[Path, list[Event]]) -> None:
    event = next(event for event in run[1] if event.evidence is not None and event.phase is Phase.ONSET)
    assert event.statistic is not None
    claimed = event.model_copy(update={"statistic": event.statistic * (1 + 2**-52)})
    again = replayed(claimed)
    assert [number.name for number in again.numbers if not number.same] == ["statistic"]
    assert not same([again])


def test_evidence_of_another_make_is_not_replayed(run: tuple[Path, list[Event]]) -> None:
    event = next(event for event in run[1] if event.evidence is not None)
    evidence = event.evidence
    assert evidence is not None
    for changes in (
        {"checkpoint": b"\0" * 8},
        {"columns": ("t_s",), "readings": ((1.0,),)},
        {"parameters": {}},
        {"parameters": {**evidence.parameters, "model": "a-later-one"}},
        {"parameters": {**evidence.parameters, "delay_s": None}},
    ):
        again = replayed(event.model_copy(update={"evidence": evidence.model_copy(update=changes)}))
        assert again.problem is not None
        assert "made by another version" in again.problem
    _, config = from_wire(evidence)
    assert config == CONFIG
    assert type(config.warming_readings) is int


def test_a_miss_has_nothing_to_replay() -> None:
    event = Event.model_construct(event_id="car1-5-miss", kind=Kind.MISS, evidence=None)
    assert replayed(event).problem == "a miss has no readings"
    assert same([replayed(event)])


def test_an_unknown_event_and_an_absent_journal_are_told_in_one_line(
    run: tuple[Path, list[Event]], tmp_path: Path
) -> None:
    with pytest.raises(UserError, match="no such event"):
        invoke("explain", "nobody-1", "--journal", run[0])
    with pytest.raises(UserError, match="is no event id"):
        invoke("explain", "no id/at all", "--journal", run[0])
    with pytest.raises(UserError, match="no journal that can be read"):
        invoke("alerts", "list", "--journal", tmp_path / "absent.sqlite")


def test_the_journal_of_the_settings_is_the_one_that_is_meant(
    run: tuple[Path, list[Event]], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HEADWAY_STATE_DIR", str(run[0].parent))
    status, out = invoke("alerts", "list", "--phase", "onset", "--limit", 1000, "--json")
    assert status == 0
    listed = {alert["event_id"] for alert in json.loads(out)["alerts"]}
    assert listed == {event.event_id for event in run[1]}
    monkeypatch.setenv("HEADWAY_STATE_DIR", "")
    with pytest.raises(UserError, match="state_dir is empty"):
        invoke("alerts", "list")


def test_everything_is_exported_oldest_first(run: tuple[Path, list[Event]], tmp_path: Path) -> None:
    journal, events = run
    in_order = sorted(event.detected_us for event in stored(events))
    lines, table, parquet = (tmp_path / f"out.{form}" for form in ("jsonl", "csv", "parquet"))
    invoke("alerts", "export", lines, "--journal", journal)
    exported = [Event.model_validate_json(line) for line in lines.read_bytes().splitlines()]
    assert [event.detected_us for event in exported] == in_order
    assert all(same([replayed(event)]) for event in exported if event.evidence is not None)
    invoke("alerts", "export", table, "--journal", journal)
    with table.open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [int(row["detected_us"]) for row in rows] == in_order
    invoke("alerts", "export", parquet, "--journal", journal)
    frame = pl.read_parquet(parquet)
    assert frame.columns == list(rows[0])
    assert frame["detected_us"].to_list() == in_order
    assert frame["recovered_x_m"].to_list() == [event.recovered and event.recovered.x_m for event in exported]


def test_an_export_is_narrowed_by_time_and_kind(run: tuple[Path, list[Event]], tmp_path: Path) -> None:
    journal, events = run
    kinds = {event.kind for event in stored(events)}
    out = tmp_path / "some.jsonl"
    for kind in kinds:
        invoke("alerts", "export", out, "--journal", journal, "--kind", kind, "--force")
        assert len(out.read_bytes().splitlines()) == sum(event.kind is kind for event in stored(events))
    status, shown = invoke("alerts", "list", "--journal", journal, "--to", "2023-11-14T22:13:20Z", "--json")
    assert (status, json.loads(shown)["alerts"]) == (0, [])
    with pytest.raises(UserError, match="no time"):
        invoke("alerts", "list", "--journal", journal, "--from", "yesterday")
    with pytest.raises(UserError, match="--kind sadness"):
        invoke("alerts", "list", "--journal", journal, "--kind", "sadness")
    with pytest.raises(UserError, match="name a file"):
        invoke("alerts", "export", "--journal", journal, "--format", "parquet")
