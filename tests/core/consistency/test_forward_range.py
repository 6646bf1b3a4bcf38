import numpy as np
import pytest
from core.estimation.following import follow

from headway.core.consistency.forward_range import RANGING, RangingParams, ranging_reset_leader, ranging_step
from headway.core.statistics.test_result import CHECK, check_budget

P = RangingParams(check_budget(0.1))
OFFSET_M = 1.3


def ranged(seconds: float, seed: int) -> np.ndarray:
    """Readings with a forward sensor that sits OFFSET_M behind the reference point: 0.2 m and 0.15 m/s of noise."""
    rng = np.random.default_rng(seed)
    readings = follow(seconds, rng)
    gap = readings["leader_x_m"] - readings["leader_length_m"] - readings["x_m"]
    readings["range_m"] = gap + OFFSET_M + rng.normal(0.0, 0.2, gap.size)
    rate = readings["leader_v_mps"] - readings["v_mps"]
    readings["range_rate_mps"] = rate + rng.normal(0.0, 0.15, gap.size)
    return readings


def run(readings: np.ndarray, row: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
    row = np.zeros(1, RANGING) if row is None else row
    checks = np.zeros(readings.size, CHECK)
    for reading, check in zip(readings, checks, strict=True):
        ranging_step(row[0], reading, P, check)
    return row, checks


def drag(readings: np.ndarray, start: int, rate_mps: float) -> None:
    t = 0.1 * np.arange(readings.size - start)
    readings["x_m"][start:] += rate_mps * t
    readings["v_mps"][start:] += rate_mps


def test_the_offset_of_the_reference_points_is_learnt() -> None:
    row, checks = run(ranged(60.0, 0))
    assert row["offset"][0] == pytest.approx([OFFSET_M, 0.0], abs=0.05)
    assert not checks["anomalous"].any()


@pytest.mark.parametrize("rate_mps", [-0.7, 0.7])
def test_a_drag_is_detected_within_two_seconds(rate_mps: float) -> None:
    readings = ranged(60.0, 1)
    drag(readings, 400, rate_mps)
    _, checks = run(readings)
    found = np.flatnonzero(checks["anomalous"])
    assert 400 < found[0] < 420


def test_a_drag_of_the_leader_is_detected_as_well() -> None:
    readings = ranged(60.0, 2)
    readings["leader_x_m"][400:] -= 0.07 * np.arange(200)
    _, checks = run(readings)
    assert not checks["anomalous"][:400].any()
    assert checks["anomalous"][450:].all()


def test_range_alone_is_enough() -> None:
    readings = ranged(60.0, 3)
    readings["range_rate_mps"] = np.nan
    drag(readings, 400, 0.7)
    _, checks = run(readings)
    assert not checks["anomalous"][:400].any()
    assert checks["anomalous"][460:].all()


def test_one_outlier_of_the_range_is_no_fault() -> None:
    readings = ranged(60.0, 4)
    readings["range_m"][400] += 2.0
    _, checks = run(readings)
    assert not checks["anomalous"].any()


def test_without_a_range_the_check_is_warming() -> None:
    _, checks = run(follow(30.0, np.random.default_rng(5)))
    assert checks["warming"].all()
    assert not checks["anomalous"].any()


def test_a_sensor_that_measures_another_vehicle_for_long_is_learnt_again() -> None:
    readings = ranged(120.0, 6)
    readings["range_m"][300:] -= 15.0
    _, checks = run(readings)
    assert checks["anomalous"][320:800].all()
    assert not checks["anomalous"][1050:].any()


def test_short_disputes_do_not_add_up_to_a_long_one() -> None:
    readings = ranged(140.0, 8)
    for start in (300, 800):
        readings["range_m"][start : start + 400] -= 15.0
    _, checks = run(readings)
    assert checks["anomalous"][850:1200].all()
    assert not checks["warming"][200:].any()


def test_a_new_leader_has_other_offsets() -> None:
    readings = ranged(60.0, 7)
    row, _ = run(readings[:300])
    ranging_reset_leader(row[0])
    readings["range_m"][300:] += 2.0
    _, checks = run(readings[300:], row)
    assert checks["warming"][:90].all()
    assert not checks["anomalous"].any()
