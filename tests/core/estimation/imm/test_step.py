"""The default model from reading to verdict."""

import numpy as np
import pytest
from core.driving import NOISE, drive, run_model

from headway.core.estimation.imm.step import KNOWN_WARMING_READINGS, headway_dtype, headway_params, step_batch
from headway.core.runtime.rows import readings, verdicts
from headway.core.types.config import DetectorConfig
from headway.core.types.records import Kind, Sensor

SENSORS = {"x_m": Sensor.LOCATION, "v_mps": Sensor.SPEED}
FAULT = slice(600, 618)
SETTLED = 200
"""Readings after which noise and driver are known, and chance alarms are one an hour."""
RECOVERED = {Kind.NOISE: 0.2, Kind.BIAS: 0.1, Kind.DRIFT: 0.5}
"""Share of the fault that may be left: a drift of 0.5 m/s2 is an acceleration until the location contradicts it."""


@pytest.mark.parametrize("column", ["x_m", "v_mps"])
@pytest.mark.parametrize("kind", [Kind.NOISE, Kind.BIAS, Kind.DRIFT])
def test_sensor_and_kind_are_named_and_the_truth_is_recovered(column: str, kind: Kind) -> None:
    rng = np.random.default_rng(0)
    read, x, v = drive(rng)
    offsets = {
        Kind.NOISE: rng.normal(0.0, 1.0, 18),
        Kind.BIAS: np.full(18, 0.9),
        Kind.DRIFT: np.linspace(0.0, 0.9, 18),
    }
    read[column][FAULT] += offsets[kind]
    results, _ = run_model(read)
    last = results[FAULT][-1]
    assert last["anomalous"]
    assert last["sensor"] == SENSORS[column]
    assert last["kind"] == kind
    assert last["confidence"] > 0.6
    for name, truth in (("x_m", x), ("v_mps", v)):
        wrong = results[name][FAULT] - truth[FAULT]
        assert np.sqrt(np.mean(wrong**2)) < RECOVERED[kind] * np.sqrt(np.mean(offsets[kind] ** 2))
    assert not results["anomalous"][SETTLED:600].any()
    assert not results["anomalous"][622:].any()


@pytest.mark.parametrize("alarm_budget_per_hour", [1.0, 1e-3])
def test_a_fault_beyond_doubt_is_an_alarm_at_any_budget(alarm_budget_per_hour: float) -> None:
    """The noise is that of a receiver, whose heavy tail takes the gate of a small budget beyond all log odds."""
    read, _, _ = drive(np.random.default_rng(0), x_std=0.05, v_std=0.05)
    read["v_mps"][FAULT] += 5.0
    results, _ = run_model(read, alarm_budget_per_hour=alarm_budget_per_hour)
    assert results["anomalous"][FAULT].all()
    assert not results["anomalous"][SETTLED:600].any()


def test_one_bad_reading_is_short_and_its_confidence_modest() -> None:
    read, _, _ = drive(np.random.default_rng(1))
    read["x_m"][600] += 0.7
    results, _ = run_model(read)
    anomalous = SETTLED + np.flatnonzero(results["anomalous"][SETTLED:])
    assert anomalous[0] == 600
    assert anomalous[-1] <= 601, "one reading later all is well, or nearly"
    assert results[600]["kind"] == Kind.SHORT
    assert results[600]["confidence"] < 0.2


def test_two_faults_at_once_are_isolated_as_both() -> None:
    rng = np.random.default_rng(2)
    read, _, _ = drive(rng)
    read["x_m"][FAULT] += 1.5
    read["v_mps"][605:618] += rng.normal(0.0, 2.0, 13)
    results, _ = run_model(read)
    assert (results["sensor"][607:618] == Sensor.BOTH).mean() > 0.8


def test_the_std_of_the_estimate_is_consistent() -> None:
    """Two-sided: 900 readings of 20 drives, errors correlated over some ten of them."""
    scaled = []
    for seed in range(20):
        read, x, v = drive(np.random.default_rng(seed))
        results, _ = run_model(read)
        scaled.append((results["x_m"] - x)[100:] / results["x_std_m"][100:])
        scaled.append((results["v_mps"] - v)[100:] / results["v_std_mps"][100:])
    assert 0.6 < np.mean(np.square(scaled)) < 1.4


def test_the_first_verdicts_are_warming_and_never_alarms() -> None:
    read, _, _ = drive(np.random.default_rng(3))
    read["x_m"][5:15] += 3.0
    results, _ = run_model(read, warming_readings=20)
    assert results["warming"][:20].all()
    assert not results["warming"][20:].any()
    assert not results["anomalous"][:20].any()


def test_a_silence_initialises_the_motion_but_keeps_the_adapted_noise() -> None:
    read, _, _ = drive(np.random.default_rng(4))
    read["t_s"][500:] += 60.0
    read["x_m"][500:] += 777.0
    results, bank = run_model(read, max_gap_s=5.0)
    np.testing.assert_array_equal(np.flatnonzero(results["restarted"]), [500])
    assert results["warming"][500 : 500 + KNOWN_WARMING_READINGS].all()
    assert not results["warming"][500 + KNOWN_WARMING_READINGS :].any()
    assert not results["anomalous"][500:].any()
    assert results["x_m"][500] == pytest.approx(read["x_m"][500])
    assert bank[0]["noise"]["adapted_readings"] > 600


def test_an_offset_that_does_not_end_is_accepted_within_seconds() -> None:
    read, x, _ = drive(np.random.default_rng(5))
    read["x_m"][600:] += 4.0
    results, _ = run_model(read)
    assert results["anomalous"][600]
    assert not results["anomalous"][630:].any()
    assert results["x_m"][700] == pytest.approx(x[700] + 4.0, abs=0.1)


def test_a_speed_below_zero_is_a_fault_of_the_speed_sensor() -> None:
    read, _, _ = drive(np.random.default_rng(6))
    read["v_mps"][600:604] = -0.5
    results, _ = run_model(read)
    assert results["anomalous"][600:604].all()
    assert (results["sensor"][600:604] == Sensor.SPEED).all()


def test_a_car_that_starts_or_stops_does_not_raise_an_alarm() -> None:
    """Wheel-speed sensors read zero below walking pace: the reported speed jumps, and location agrees."""
    n = 900
    rng = np.random.default_rng(7)
    v = np.clip(0.8 * (np.abs(np.arange(n) - 450) * 0.1 - 10.0), 0.0, 12.0)
    v[v < 0.35] = 0.0
    read = readings(n)
    read["t_s"] = 0.1 * np.arange(n)
    read["x_m"] = np.r_[0.0, np.cumsum(0.05 * (v[1:] + v[:-1]))] + rng.normal(0, NOISE, n)
    read["v_mps"] = np.maximum(v + rng.normal(0, NOISE, n), 0.0)
    results, _ = run_model(read)
    assert not results["anomalous"][SETTLED:].any()


@pytest.mark.parametrize("budget", [0.2, 5.0])
def test_a_greater_budget_lowers_the_gate(budget: float) -> None:
    read, _, _ = drive(np.random.default_rng(8))
    ordinary, _ = run_model(read)
    other, _ = run_model(read, alarm_budget_per_hour=budget)
    assert np.sign(other["gate"][-1] - ordinary["gate"][-1]) == np.sign(1.0 - budget)
    np.testing.assert_allclose(other["statistic"], ordinary["statistic"])


def test_the_p_value_is_the_share_of_clean_readings_with_such_a_statistic() -> None:
    read, _, _ = drive(np.random.default_rng(9))
    read["x_m"][600] += 0.7
    results, _ = run_model(read)
    assert results["p_value"][600] < 1e-6
    assert (results["p_value"][~results["anomalous"]][1:] > 1.0 / 36_000.0).all()


def test_a_batch_is_its_rows_one_by_one() -> None:
    config = DetectorConfig()
    drives = [drive(np.random.default_rng(seed), n=60)[0] for seed in range(4)]
    drives[2]["x_m"][40:] += 1.0
    bank, rows = np.zeros(9, headway_dtype(config.delay_s)), np.array([7, 2, 5, 0])
    together = [verdicts(4) for _ in range(60)]
    for k in range(60):
        step_batch(bank, rows, np.array([read[k] for read in drives]), headway_params(config), together[k])
    for place, read in enumerate(drives):
        alone, row = run_model(read)
        np.testing.assert_array_equal(np.array([results[place] for results in together]), alone)
        assert bank[rows[place]].tobytes() == row[0].tobytes()
    assert not bank[[1, 3, 4, 6, 8]].view(np.uint8).any()


def test_a_new_vehicle_has_a_higher_gate() -> None:
    read, _, _ = drive(np.random.default_rng(8))
    results, _ = run_model(read)
    gate = results["gate"]
    assert gate[31] > gate[100] + 4.0
    assert gate[100] > gate[SETTLED] + 1.0
    assert gate[31:].max() < 20.0, "log odds go up to 23"


def onsets(read) -> int:
    """Return how many alarms begin once the model has warmed up, a second apart."""
    results, _ = run_model(read)
    at = np.flatnonzero(results["anomalous"] & ~results["warming"])
    return int((np.diff(at, prepend=-11) > 10).sum())


def test_a_location_smoothed_by_its_receiver_is_no_fault() -> None:
    """It is the sum of the reported speeds, and what it is off by changes over seconds, not from reading to reading."""
    alarms = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        read, _, v = drive(rng, n=1800)
        read["v_mps"] = v + rng.normal(0.0, 0.02, read.size)
        slip_mps = np.zeros(read.size)
        for k in range(1, read.size):
            slip_mps[k] = 0.95 * slip_mps[k - 1] + rng.normal(0.0, 0.0045)
        read["x_m"] = np.cumsum(0.1 * (read["v_mps"] + slip_mps))
        alarms += onsets(read)
    assert alarms <= 6, "in 36 minutes; dozens if so steady a location had no random walk"


def test_a_random_walk_from_the_first_reading_on_is_soon_found() -> None:
    alarms = 0
    for seed in range(60):
        rng = np.random.default_rng(seed)
        read, x, _ = drive(rng, n=200, v_std=0.02)
        read["x_m"] = x + np.cumsum(rng.normal(0.0, 0.012, read.size))
        alarms += onsets(read)
    assert alarms <= 6, "in 20 minutes of vehicles that are 20 s old"
