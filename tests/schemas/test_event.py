import json
import math

import pytest
from pydantic import ValidationError

from headway_schemas import Event, Evidence, Innovation, Kind, Phase, Recovered, Sensor
from headway_schemas.event import EtsiTarget, Observation, Stage

EVENT = Event(
    event_id="e-1",
    phase=Phase.ONSET,
    kind=Kind.BIAS,
    sensor=Sensor.SPEED,
    suspect="b",
    leader="a",
    follower="b",
    site="s",
    t_us=1_700_000_000_000_000,
    detected_us=1_700_000_000_004_000,
    nis=31.5,
    statistic=12.0,
    gate=9.2,
    p_value=1e-4,
    innovation=Innovation(x_m=0.1, v_mps=2.0),
    recovered=Recovered(x_m=120.0, v_mps=13.5, x_std_m=0.3, v_std_mps=math.nan),
    latency_us={Stage.WIRE: -200, Stage.QUEUE: 1500},
    model="headway",
    config_hash="0123456789ab",
    instance="edge-1",
    sequence=7,
    count=3,
    confidence=0.9,
    etsi_target=EtsiTarget.SPEED,
    observations=(Observation.SPEED_CHANGE,),
    evidence=Evidence(
        columns=["t_s", "x_m"],
        readings=[[0.0, 1.0], [0.1, math.nan]],
        checkpoint=b"\xfb\xff\xfe\x00",
        parameters={"delay_s": 0.5, "model": "headway", "bound": math.inf},
    ),
)


def test_json_there_and_back() -> None:
    assert Event.model_validate_json(EVENT.model_dump_json()) == EVENT


def test_the_fields_are_those_of_the_contract() -> None:
    assert list(json.loads(EVENT.model_dump_json())) == [
        "event_id", "phase", "kind", "sensor", "suspect", "leader", "follower", "site", "t_us", "detected_us",
        "onset_us", "nis", "statistic", "gate", "p_value", "innovation", "recovered", "deviation", "latency_us",
        "model", "config_hash", "instance", "sequence", "epoch", "count", "confidence", "etsi_target", "observations",
        "evidence",
    ]  # fmt: skip


def test_what_is_not_finite_is_null() -> None:
    wire = json.loads(EVENT.model_dump_json())
    assert wire["recovered"]["v_std_mps"] is None
    assert Event.model_validate(dict(EVENT) | {"confidence": math.nan}).confidence is None
    assert wire["evidence"]["readings"] == [[0.0, 1.0], [0.1, None]]
    assert wire["evidence"]["parameters"] == {"delay_s": 0.5, "model": "headway", "bound": None}


def test_the_checkpoint_is_in_the_standard_alphabet() -> None:
    assert json.loads(EVENT.model_dump_json())["evidence"]["checkpoint"] == "+//+AA=="


def test_a_checkpoint_that_is_not_base64_is_refused() -> None:
    with pytest.raises(ValidationError, match="base64"):
        Evidence.model_validate_json('{"columns": [], "readings": [], "checkpoint": "-__-"}')


def test_an_event_may_be_named_after_the_longest_identifier() -> None:
    event_id = "x" * 64 + "-9007199254740991-link"
    assert Event.model_validate(dict(EVENT) | {"event_id": event_id}).event_id == event_id


def test_a_miss_on_a_free_road_has_neither_reading_nor_leader() -> None:
    least = {
        "event_id": "e", "phase": "onset", "kind": "miss", "sensor": "link", "suspect": "a", "follower": "a",
        "site": "s", "t_us": 0, "detected_us": 0, "model": "headway", "config_hash": "0",
    }  # fmt: skip
    event = Event.model_validate_json(json.dumps(least))
    assert event.nis is event.leader is event.recovered is event.evidence is None
