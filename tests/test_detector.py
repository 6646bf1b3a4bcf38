"""The public API: the same verdicts for every form of the same records, and a named outcome for each."""

import doctest
import math
import subprocess
import sys
from typing import Any

import numpy as np
import pandas as pd
import polars as pl
import pyarrow as pa
import pytest
from made_recording import START_US, made_recording

import headway
from headway import detector as module
from headway import sample
from headway.detector import Detector, ReceivedError
from headway.errors import UserError
from headway.result import VERDICTS, Result
from headway_schemas import Event

RECORDS = made_recording()
COLUMNS = {name: [record[name] for record in RECORDS] for name in RECORDS[0]}


@pytest.fixture(scope="module")
def result() -> Result:
    return Detector().process(RECORDS)


def test_a_fault_becomes_an_event_of_that_vehicle_and_sensor(result: Result) -> None:
    assert {event.suspect for event in result.events} == {"car1"}
    assert "speed" in {event.sensor.value for event in result.events}
    onset = result.events[0]
    assert isinstance(onset, Event)
    assert 10.0 <= (onset.t_us - START_US) / 1e6 < 11.0
    assert onset.latency_us == {"wire": onset.detected_us - onset.t_us}


def test_a_recording_may_begin_at_any_time_zero_too(result: Result) -> None:
    times = ("t_us", "received_us")
    first_us = min(record["t_us"] for record in RECORDS)
    records = [{**record, **{name: record[name] - first_us for name in times}} for record in RECORDS]
    shifted = Detector().process(records)
    for name in ("outcome", "anomalous", "sensor", "kind", "leader"):
        assert (shifted.verdicts[name] == result.verdicts[name]).all()
    assert len(shifted.events) == len(result.events)


def test_there_is_a_verdict_for_each_record_in_order(result: Result) -> None:
    assert result.verdicts.dtype == VERDICTS
    assert len(result.verdicts) == len(RECORDS)
    faulty = np.array([record["id"] == "car1" for record in RECORDS])
    assert set(result.verdicts["outcome"][:40]) == {"warming"}
    assert set(result.verdicts["outcome"][-40:]) == {"scored"}
    assert not result.verdicts["anomalous"][~faulty].any()
    assert result.verdicts["anomalous"][faulty].sum() > 30
    assert "speed" in result.verdicts["sensor"][result.verdicts["anomalous"]]
    assert set(result.verdicts["leader"][-40:]) == {"", "car0", "car1", "car2"}


@pytest.mark.parametrize(
    "form",
    [
        pytest.param(COLUMNS, id="lists"),
        pytest.param({name: np.array(column) for name, column in COLUMNS.items()}, id="arrays"),
        pytest.param(pl.DataFrame(COLUMNS), id="polars"),
        pytest.param(pd.DataFrame(COLUMNS), id="pandas"),
        pytest.param(pa.table(COLUMNS), id="arrow"),
        pytest.param(pl.DataFrame(COLUMNS).drop("v"), id="without version"),
    ],
)
def test_every_form_of_a_table_gives_the_same(form: Any, result: Result) -> None:
    same = Detector().process(form)
    assert same.verdicts.tobytes() == result.verdicts.tobytes()
    assert same.events == result.events


def test_invalid_records_are_named_as_the_service_names_them() -> None:
    good = RECORDS[0]
    chunk = [
        good,
        good | {"speed_mps": 999.0},
        good | {"speed_mps": "fast"},
        good | {"speed_mps": None},
        good | {"lat": math.inf},
        good | {"v": 2},
        good | {"colour": "red"},
        good | {"id": "a/b"},
        good,
        "no record",
    ]
    result = Detector().process(chunk)
    assert result.verdicts["outcome"].tolist() == [
        "warming",
        "out_of_range",
        "malformed",
        "unavailable",
        "not_finite",
        "wrong_version",
        "malformed",
        "malformed",
        "duplicate",
        "malformed",
    ]
    assert set(result.problems) == {1, 2, 3, 4, 5, 6, 7, 9}
    assert np.isnan(result.verdicts["statistic"][1:]).all()


def test_a_declared_leader_comes_as_a_map_or_in_columns_of_its_own() -> None:
    leader = {"id": "car9", "range_m": 20.0, "range_rate_mps": 0.5}
    as_map = {"leader": [leader, None]}
    in_columns = {f"leader.{name}": [value, None] for name, value in leader.items()}
    two = {name: column[:2] for name, column in COLUMNS.items()}
    for form in (as_map, in_columns):
        assert Detector().process(two | form).verdicts["outcome"].tolist() == ["warming"] * 2
    wrong = {"leader.id": ["a b", None]}
    assert Detector().process(two | wrong).verdicts["outcome"].tolist() == ["malformed", "warming"]


def test_missing_numbers_of_pandas_are_values_that_were_not_given() -> None:
    frame = pd.DataFrame({name: column[:2] for name, column in COLUMNS.items()})
    frame["accel_mps2"] = [0.5, np.nan]
    frame["msg_cnt"] = [1.0, np.nan]
    assert Detector().process(frame).verdicts["outcome"].tolist() == ["warming", "unavailable"]


@pytest.mark.parametrize(
    ("chunk", "words"),
    [
        ({"id": ["a"], "speed": [1.0]}, "unknown column speed: did you mean speed_mps?"),
        ({"id": ["a"]}, "column msg_cnt is missing"),
        ({"id": ["a"], "msg_cnt": [1, 2]}, "columns differ in length"),
    ],
)
def test_a_table_with_wrong_columns_is_refused(chunk: dict[str, list[Any]], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        Detector().process(chunk)


def test_a_time_of_reception_that_is_none_is_refused_with_its_place() -> None:
    with pytest.raises(ReceivedError, match="record 1: received_us is 'now'"):
        Detector().process([RECORDS[0], RECORDS[1] | {"received_us": "now"}])


def test_anything_else_is_no_chunk() -> None:
    with pytest.raises(TypeError, match="int: not a table"):
        Detector().process(5)


def test_settings_are_checked_as_those_of_the_service() -> None:
    with pytest.raises(UserError, match="unknown setting dealy_s: did you mean delay_s"):
        Detector(dealy_s=1.0)
    with pytest.raises(UserError, match="delay_s = 99"):
        Detector(delay_s=99)
    with pytest.raises(UserError, match="unknown setting http_port"):
        Detector(http_port=1)


def test_the_environment_changes_nothing(monkeypatch: pytest.MonkeyPatch, result: Result) -> None:
    monkeypatch.setenv("HEADWAY_ALARM_BUDGET_PER_HOUR", "3000")
    assert Detector().process(RECORDS).verdicts.tobytes() == result.verdicts.tobytes()


def test_an_empty_chunk_is_no_error() -> None:
    assert len(Detector().process([]).verdicts) == 0


def test_a_picture_of_a_vehicle_shows_readings_and_estimates(result: Result) -> None:
    figure = result.plot("car1")
    speed, location, statistic = figure.axes
    reported, estimate = speed.get_lines()
    assert len(reported.get_xdata()) == sum(record["id"] == "car1" for record in RECORDS)
    faulty = slice(100, 110)
    assert np.median(reported.get_ydata()[faulty] - estimate.get_ydata()[faulty]) == pytest.approx(8.0, abs=1.0)
    assert location.get_ylabel() == "location, m"
    assert statistic.get_ylabel() == "statistic / gate"
    with pytest.raises(ValueError, match="no record of car7"):
        result.plot("car7")


def test_the_examples_in_the_docstrings_are_right() -> None:
    for of in (headway, module, sample):
        assert doctest.testmod(of).failed == 0


def test_importing_headway_is_light() -> None:
    code = (
        "import sys, headway; print(headway.__version__); sys.exit('numba' in sys.modules or 'pydantic' in sys.modules)"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_the_names_of_the_package_are_the_public_api() -> None:
    assert headway.Detector is Detector
    assert headway.Result is Result
    with pytest.raises(AttributeError, match="no attribute 'Detect'"):
        headway.Detect  # noqa: B018
