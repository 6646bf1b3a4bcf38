"""The same records give the same verdicts and events, whatever the chunks that they come in."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from made_recording import made_recording

from headway.detector import Detector
from headway_schemas import Event

SETTINGS = {"vehicle_capacity": 7, "vehicle_ttl_s": 4.0, "max_ahead_s": 5.0}


def hard_recording() -> list[dict[str, Any]]:
    """Cars that lead each other, a speed fault, silences, copies, swaps, invalid records, new ids, a clock set back."""
    rng = np.random.default_rng(3)
    records = []
    for record in made_recording(6, 24.0, fault=(9.0, 13.0)):
        car, t_s = int(record["id"][3:]), (record["t_us"] - 1_700_000_000_000_000) / 1e6
        if car == 2 and 15.0 < t_s < 16.5:
            continue
        if car == 5 and t_s > 8.0:
            record |= {"id": f"new{int(t_s) // 3}"}
        if car == 3:
            record |= {"leader": {"id": "car2", "range_m": 25.5, "range_rate_mps": 0.0}}
        records.append(record)
        if rng.random() < 0.02:
            records.append(record | {"received_us": record["received_us"] + 3_000})
        if rng.random() < 0.02:
            records.append(record | {"speed_mps": 999.0})
        if rng.random() < 0.02:
            records.append(record | {"t_us": record["t_us"] - 50_000})
        if rng.random() < 0.05 and len(records) > 1:
            records[-1], records[-2] = records[-2], records[-1]
    for record in records[-200:]:
        record["received_us"] -= 1_200_000
    return records


RECORDS = hard_recording()


def played(cuts: list[int]) -> tuple[bytes, list[Event]]:
    detector = Detector(**SETTINGS)
    edges = sorted({0, len(RECORDS), *cuts})
    results = [detector.process(RECORDS[a:b]) for a, b in pairwise(edges)] + [detector.finish()]
    verdicts = np.concatenate([result.verdicts for result in results])
    return verdicts.tobytes(), [event for result in results for event in result.events]


@pytest.fixture(scope="module")
def whole() -> tuple[bytes, list[Event]]:
    return played([])


def test_the_recording_has_something_of_everything(whole: tuple[bytes, list[Event]]) -> None:
    result = Detector(**SETTINGS).process(RECORDS)
    outcomes = set(result.verdicts["outcome"].tolist())
    rejected = {"duplicate", "out_of_order", "out_of_range", "table_full", "from_the_future"}
    assert outcomes == {"scored", "warming"} | rejected
    assert {"car1", "car2"} <= {event.suspect for event in whole[1]}
    assert "miss" in {event.kind.value for event in whole[1]}
    assert len(set(result.verdicts["leader"].tolist())) > 4


def test_record_by_record_gives_the_same(whole: tuple[bytes, list[Event]]) -> None:
    assert played(list(range(len(RECORDS)))) == whole


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(st.integers(0, len(RECORDS)), max_size=60))
def test_any_chunks_give_the_same(whole: tuple[bytes, list[Event]], cuts: list[int]) -> None:
    assert played(cuts) == whole


def test_every_event_is_cleared_at_the_end(whole: tuple[bytes, list[Event]]) -> None:
    phases = {event.event_id: event.phase.value for event in whole[1]}
    assert set(phases.values()) == {"cleared"}
