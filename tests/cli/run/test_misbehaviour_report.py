import io
import json
from datetime import UTC, datetime

import pytest

from headway.cli.run.misbehaviour_report import report_of, write_reports
from headway_schemas import Event
from headway_schemas.event import Kind, Observation, Phase, Sensor

DETECTED = datetime(2024, 5, 1, 12, 0, tzinfo=UTC)


def event(*observations: Observation, phase: Phase = Phase.ONSET) -> Event:
    us = round(DETECTED.timestamp() * 1e6)
    return Event(
        event_id="i-1", phase=phase, kind=Kind.SHORT, sensor=Sensor.LOCATION, suspect="a", follower="a", site="s",
        t_us=us - 1000, detected_us=us, model="headway", config_hash="c", observations=observations,
    )  # fmt: skip


def report(*observations: Observation) -> dict:
    return report_of(json.loads(event(*observations).model_dump_json()))


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
