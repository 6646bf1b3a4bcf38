import io
import json
from collections.abc import Sequence
from datetime import UTC, datetime

import pytest

from headway.cli.run.misbehaviour.report import report_of, write_reports
from headway_schemas import Event
from headway_schemas.encodings import J2735_UPER
from headway_schemas.event import Evidence, Kind, Observation, OriginalMessage, Phase, Sensor

DETECTED = datetime(2024, 5, 1, 12, 0, tzinfo=UTC)


def event(*observations: Observation, phase: Phase = Phase.ONSET, messages: Sequence[bytes] = ()) -> Event:
    us = round(DETECTED.timestamp() * 1e6)
    originals = tuple(OriginalMessage(received_us=us, encoding=J2735_UPER, payload=one) for one in messages)
    evidence = Evidence(columns=(), readings=(), messages=originals) if messages else None
    return Event(
        event_id="i-1", phase=phase, kind=Kind.SHORT, sensor=Sensor.LOCATION, suspect="a", follower="a", site="s",
        t_us=us - 1000, detected_us=us, model="headway", config_hash="c", observations=observations,
        evidence=evidence,
    )  # fmt: skip


def report(*observations: Observation, messages: Sequence[bytes] = ()) -> dict:
    return report_of(json.loads(event(*observations, messages=messages).model_dump_json()))


@pytest.mark.parametrize(
    ("observation", "target", "number", "name"),
    [
        (Observation.ACCELERATION, 5, 4, "LongAcc-ValueTooLarge"),
        (Observation.POSITION_CHANGE, 3, 4, "Position-ChangeTooLarge"),
        (Observation.SPEED_CHANGE, 4, 5, "Speed-ChangeTooLarge"),
        (Observation.INTERVAL, 0, 1, "Beacon-IntervalTooSmall"),
    ],
)
def test_what_the_standard_names(observation: Observation, target: int, number: int, name: str) -> None:
    content = report(observation)["report"]["content"]
    assert content["observations"] == [{"tgtId": target, "observations": [{"obsId": number, "obs": name}]}]


def test_time_is_tai_since_2004_and_the_application_that_of_the_message() -> None:
    made = report(Observation.IDENTITY)
    utc_us = (DETECTED - datetime(2004, 1, 1, tzinfo=UTC)).total_seconds() * 1e6
    assert made["generationTime"] == utc_us + 5e6
    assert made["report"]["aid"] == 32
    assert made["report"]["content"]["observations"] == []
    assert made["headway"]["observations"] == ["identity"]


def test_the_end_of_an_event_is_no_report() -> None:
    lines = [event(phase=phase).model_dump_json().encode() for phase in Phase]
    out = io.BytesIO()
    assert write_reports(lines, out) == 2
    assert [json.loads(line)["headway"]["phase"] for line in out.getvalue().splitlines()] == ["onset", "update"]


@pytest.mark.parametrize(
    ("message", "pdu"),
    [
        (b"\x00\x14\x01", "038003001401"),
        (b"001401", "038003001401"),
        (b"\x03\x80\x01a", "03800161"),
        (b"\x03\x81\x00", "038100"),
        (bytes(200), "038081C8" + "00" * 200),
        (bytes(300), "038082012C" + "00" * 300),
    ],
)
def test_the_evidence_is_the_original_messages(message: bytes, pdu: str) -> None:
    made = report(Observation.INTERVAL, messages=[b"\x00\x14\x02", message])
    (stream,) = made["report"]["content"]["v2xPduEvidence"]
    assert stream == {"type": 2, "v2xPdus": ["038003001402", pdu], "subjectPduIndex": 1}
    assert [one["encoding"] for one in made["headway"]["messages"]] == [J2735_UPER] * 2


def test_without_messages_there_is_no_stream() -> None:
    assert report(Observation.INTERVAL)["report"]["content"]["v2xPduEvidence"] == []
