import numpy as np
import pytest

from headway_loadtest.inject.consistent import (
    BRAKE_MPS,
    CONSISTENT,
    DRAG_MPS,
    SAMPLE_S,
    inject_consistent,
    samples,
    speed_offset,
)
from headway_loadtest.inject.faults import Kind, Sensor, Spec, SpecError

T_S = SAMPLE_S * np.arange(3000)
V_MPS = 15.0 + 3.0 * np.sin(0.2 * T_S) + np.sin(0.07 * T_S)
X_M = np.concatenate([[0.0], np.cumsum(0.5 * SAMPLE_S * (V_MPS[1:] + V_MPS[:-1]))])


def injected(kind: Kind, seed: int = 0, p: float = 0.003):
    return inject_consistent(np.random.default_rng(seed), X_M, V_MPS, Spec(p=p, kinds=(kind,)))


@pytest.mark.parametrize("kind", CONSISTENT)
def test_location_is_the_integral_of_speed(kind: Kind) -> None:
    corrupted = injected(kind)
    assert corrupted.events
    assert np.diff(corrupted.x_m) == pytest.approx(
        0.5 * SAMPLE_S * (corrupted.v_mps[1:] + corrupted.v_mps[:-1]), abs=1e-9
    )


@pytest.mark.parametrize("kind", CONSISTENT)
def test_motion_stays_smooth(kind: Kind) -> None:
    """No acceleration leaves what a car can do, and none jumps."""
    a_mps2 = np.diff(injected(kind).v_mps) / SAMPLE_S
    assert np.abs(a_mps2).max() < 9.0
    assert np.abs(np.diff(a_mps2)).max() < 1.0


@pytest.mark.parametrize("kind", CONSISTENT)
def test_labels_are_where_the_speed_is_false(kind: Kind) -> None:
    corrupted = injected(kind)
    false = np.abs(corrupted.v_mps - V_MPS) > 1e-12
    assert not false[corrupted.v_kind == Kind.NONE].any()
    assert (corrupted.x_kind == corrupted.v_kind).all()
    assert set(np.unique(corrupted.v_kind)) == {Kind.NONE, kind}
    assert all(event.sensor is Sensor.BOTH and event.kind is kind for event in corrupted.events)
    assert all(false[event.start : event.start + 15].any() for event in corrupted.events)


def test_feigned_brake_dips_by_three_metres_a_second_over_four_seconds() -> None:
    offset = speed_offset(np.random.default_rng(0), Kind.FEIGNED_BRAKE, V_MPS, 100)
    assert len(offset) * SAMPLE_S == pytest.approx(4.0)
    assert offset.min() == pytest.approx(-BRAKE_MPS)
    assert offset.sum() * SAMPLE_S == pytest.approx(-6.0, abs=0.01)


def test_drag_pulls_the_location_by_seven_metres_to_either_side() -> None:
    ends = {
        round(float(speed_offset(np.random.default_rng(seed), Kind.DRAG, V_MPS, 100).sum() * SAMPLE_S), 1)
        for seed in range(20)
    }
    assert ends == {-10 * DRAG_MPS, 10 * DRAG_MPS}


def test_replay_tells_what_was_driven_before() -> None:
    seed = 3
    lag = round(np.random.default_rng(seed).uniform(10.0, 60.0) / SAMPLE_S)
    corrupted = V_MPS[1000:1180] + speed_offset(np.random.default_rng(seed), Kind.REPLAY, V_MPS, 1000)
    assert corrupted[30:150] == pytest.approx(V_MPS[1030 - lag : 1150 - lag])


def test_freeze_keeps_the_last_speed() -> None:
    corrupted = V_MPS[500:630] + speed_offset(np.random.default_rng(0), Kind.FREEZE, V_MPS, 500)
    assert corrupted[:100] == pytest.approx(V_MPS[500])


def test_no_lie_tells_a_negative_speed() -> None:
    slow = np.full(300, 0.5)
    for kind in CONSISTENT:
        offset = speed_offset(np.random.default_rng(1), kind, slow, 100)
        assert (slow[100 : 100 + len(offset)] + offset >= 0.0).all()


def test_a_lie_at_the_end_of_a_drive_is_cut_there() -> None:
    assert len(speed_offset(np.random.default_rng(0), Kind.REPLAY, V_MPS, len(V_MPS) - 30)) == 30
    assert samples(Kind.REPLAY) == 180


def test_kinds_that_touch_one_sensor_are_refused() -> None:
    with pytest.raises(SpecError, match="bias"):
        inject_consistent(np.random.default_rng(0), X_M, V_MPS, Spec(kinds=(Kind.DRAG, Kind.BIAS)))
