"""Whatever valid records come: each has an outcome, no exception, no number that is none, and a later jump is found."""

import numpy as np
import pytest
from core.traffic import LATENCY_US, START_US
from hypothesis import given, settings
from hypothesis import strategies as st

from headway.core.engine import Engine
from headway.core.estimation.registry import MODELS
from headway.core.pipeline.finiteness import SPEED_MAX_MPS
from headway.core.types.batch import Batch
from headway.core.types.config import DetectorConfig
from headway.core.types.identifiers import id_column
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import RecordVerdicts

DETERMINANT_OF_ZERO = [
    (0, 42.0, 17.0, 0.0),
    (100_000, 42.0, -83.0, 0.0),
    (4_990_000, -38.0, 97.0, 15.0),
    (100_000, 42.01, 97.0, 0.0),
    (1, 42.01, 97.0, 0.0),
    (1, 52.0, 97.0, 0.0),
    (100_000, 52.0, -82.99, 163.8),
    (100_000, 42.01, -83.0, 15.0),
    (100_000, 42.01, 17.0, 15.0),
    (2_500_000, 42.0, -83.0, 0.0),
]
"""Steps (us, deg, deg, m/s) with which a determinant of the filter cancelled to zero."""

PLACES = [0.0, 1e-7, 42.0, 42.01, -38.0, 89.9999999, 90.0, -90.0]
STEPS = st.tuples(
    st.sampled_from([1, 2, 1_000, 99_999, 100_000, 100_001, 600_000, 2_500_000, 4_990_000]),
    st.sampled_from(PLACES) | st.floats(-90.0, 90.0),
    st.sampled_from([0.0, -83.0, -82.99, 17.0, 97.0, 180.0, -180.0, 179.9999999]) | st.floats(-180.0, 180.0),
    st.sampled_from([0.0, 0.02, 15.0, 163.8]) | st.floats(0.0, 163.8),
)


def record(t_us: int, k: int, lat: float, lon: float, speed_mps: float, heading_deg: float) -> Batch:
    nothing = np.full(1, np.nan)
    return Batch(
        ids=id_column(["car"]), leader_ids=id_column([None]), msg_cnt=np.array([k % 128]), t_us=np.array([t_us]),
        received_us=np.array([t_us + LATENCY_US]), lat_deg=np.array([lat]), lon_deg=np.array([lon]),
        speed_mps=np.array([speed_mps]), heading_deg=np.array([heading_deg]), accel_mps2=nothing, accuracy_m=nothing,
        length_m=nothing, range_m=nothing, range_rate_mps=nothing,
    )  # fmt: skip


def judged(engine: Engine, batch: Batch) -> tuple[Outcome, np.void]:
    out = RecordVerdicts.empty(1)
    result = engine.step(batch, int(batch.received_us[0]), out=out)
    assert result.failures == []
    return Outcome(result.outcomes[0]), out.verdicts[0]


def assert_finite(verdict: np.void) -> None:
    for name in ("x_m", "v_mps", "x_std_m", "v_std_mps", "statistic", "gate", "nis"):
        assert np.isfinite(verdict[name]), name


@pytest.mark.parametrize("model", MODELS)
@settings(max_examples=60)
@given(
    steps=st.lists(STEPS, min_size=2, max_size=60),
    heading=st.sampled_from([0.0, 180.0, 359.9, np.nan]),
    spins=st.booleans(),
)
def test_no_valid_record_leaves_a_number_that_is_none(model, steps, heading, spins) -> None:
    engine, t_us = Engine(DetectorConfig(model=model, vehicle_capacity=2)), START_US
    for k, (step_us, lat, lon, speed_mps) in enumerate(steps):
        t_us += step_us
        outcome, verdict = judged(engine, record(t_us, k, lat, lon, speed_mps, (heading + 90.0 * k * spins) % 360.0))
        if outcome in (Outcome.SCORED, Outcome.WARMING):
            assert_finite(verdict)


@pytest.mark.parametrize("model", MODELS)
def test_a_determinant_of_zero_is_judged(model) -> None:
    engine, t_us = Engine(DetectorConfig(model=model, vehicle_capacity=2)), START_US
    for k, (step_us, lat, lon, speed_mps) in enumerate(DETERMINANT_OF_ZERO):
        t_us += step_us
        outcome, verdict = judged(engine, record(t_us, k, lat, lon, speed_mps, 0.0))
        assert outcome in (Outcome.SCORED, Outcome.WARMING)
        assert_finite(verdict)


@pytest.mark.parametrize("rate", [0.01, 0.1, 0.5])
def test_a_jump_after_wild_positions_is_found(rate) -> None:
    rng, engine, t_us = np.random.default_rng(1), Engine(DetectorConfig(vehicle_capacity=2)), START_US
    found_us = None
    for k in range(700):
        t_us += 100_000
        lat = 42.0 + 1.5 * k / 111_083.0 + (500.0 / 111_083.0 if k >= 650 else 0.0)
        wild = k < 600 and rng.random() < rate
        at = (0.0, 0.0) if wild else (lat, -83.0)
        batch = record(t_us, k, *at, 15.0 + rng.normal(0.0, 0.02), 0.0)
        result = engine.step(batch, int(batch.received_us[0]))
        if k >= 650 and found_us is None and result.events:
            found_us = k - 650
    assert found_us is not None
    assert found_us <= 2


def test_a_defect_has_an_outcome_and_the_vehicle_goes_on(monkeypatch) -> None:
    engine = Engine(DetectorConfig(vehicle_capacity=2))
    for k in range(40):
        judged(engine, record(START_US + 100_000 * k, k, 42.0 + 1.5e-5 * k, -83.0, 15.0, 0.0))
    rounds = engine._rounds
    with monkeypatch.context() as defect:
        defect.setattr(rounds, "_finalise", lambda *_: 1 / 0)
        batch = record(START_US + 4_000_000, 40, 42.0006, -83.0, 15.0, 0.0)
        result = engine.step(batch, int(batch.received_us[0]))
    assert result.outcomes.tolist() == [Outcome.DETECTOR_FAILED]
    [failure] = result.failures
    assert failure.error == "ZeroDivisionError: division by zero"
    assert failure.records[0]["id"] == "car"
    assert failure.records[0]["lat_deg"] == 42.0006
    outcomes = [
        judged(engine, record(START_US + 4_100_000 + 100_000 * k, 41 + k, 42.0006 + 1.5e-5 * k, -83.0, 15.0, 0.0))[0]
        for k in range(40)
    ]
    assert outcomes[0] is Outcome.WARMING
    assert outcomes[-1] is Outcome.SCORED


def test_an_estimate_that_no_vehicle_can_have_is_made_again_from_the_reading(monkeypatch) -> None:
    engine = Engine(DetectorConfig(vehicle_capacity=2))
    for k in range(40):
        judged(engine, record(START_US + 100_000 * k, k, 42.0 + 1.5e-5 * k, -83.0, 16.7, 0.0))
    step_batch = engine._rounds._step_batch

    def run_away(bank, rows, readings, params, verdicts) -> None:
        step_batch(bank, rows, readings, params, verdicts)
        verdicts["v_mps"] = -1.1 * SPEED_MAX_MPS

    monkeypatch.setattr(engine._rounds, "_step_batch", run_away)
    outcome, verdict = judged(engine, record(START_US + 4_000_000, 40, 42.0006, -83.0, 16.7, 0.0))
    assert (outcome, verdict["restarted"], verdict["v_mps"]) == (Outcome.WARMING, True, 16.7)
