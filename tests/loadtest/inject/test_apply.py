import numpy as np
import pytest

from headway_loadtest.inject.apply import corrupt, sendable_speed
from headway_loadtest.inject.faults import Kind, Sensor, Spec
from headway_loadtest.sources.drive import Ahead, Drive
from headway_loadtest.sources.road import Road

METRES_PER_DEGREE = 111_000.0
N = 1200


def drive(vehicle="a", n=N, t_s=None):
    x_m = 1.2 * np.arange(n)
    lat, lon, heading_deg = Road.winding(42.3, -83.7, 0.0, 1.2 * n).at(x_m)
    return Drive(
        vehicle=vehicle,
        t_s=np.arange(n) / 10 if t_s is None else t_s,
        x_m=x_m,
        speed_mps=np.full(n, 12.0),
        lat=lat,
        lon=lon,
        heading_deg=heading_deg,
        ahead=Ahead(("b",), np.zeros(n, np.int64), np.full(n, 20.0), np.zeros(n)),
    )


def inject_kinds(*kinds, seed=1, truth=None, **spec):
    return corrupt(truth or drive(), seed, Spec(kinds=kinds, p=0.01, **spec))


def moved_m(truth, sent):
    east_m = (sent.lon - truth.lon) * METRES_PER_DEGREE * np.cos(np.radians(42.3))
    return np.hypot((sent.lat - truth.lat) * METRES_PER_DEGREE, east_m)


def test_a_false_location_is_a_place_along_the_road():
    truth = drive()
    sent, labels = inject_kinds(Kind.BIAS, c=25.0)
    assert {label.sensor for label in labels} == {Sensor.LOCATION, Sensor.SPEED}
    assert np.allclose(moved_m(truth, sent), np.abs(sent.x_m - truth.x_m), atol=0.1)
    assert moved_m(truth, sent).max() > 3.0


def test_labels_are_the_samples_that_changed():
    truth = drive()
    sent, labels = inject_kinds(Kind.NOISE, c=4.0)
    false = np.zeros(N, bool)
    for label in labels:
        if label.sensor is Sensor.SPEED:
            false |= (truth.t_s * 1e6 >= label.start_us - 1) & (truth.t_s * 1e6 <= label.stop_us + 1)
    assert np.array_equal(false, sent.speed_mps != truth.speed_mps)
    assert false.any()


def test_a_miss_is_not_sent_and_runs_from_reading_to_reading():
    sent, labels = inject_kinds(Kind.MISS)
    assert len(sent.t_s) < N
    assert labels
    sent_us = set(np.round(sent.t_s * 1e6).astype(int).tolist())
    for label in labels:
        assert {label.start_us, label.stop_us} <= sent_us
        assert not sent_us & set(range(label.start_us + 1, label.stop_us))
    assert sent.ahead is not None
    assert len(sent.ahead.which) == len(sent.lat) == len(sent.t_s)


def test_a_silence_at_either_end_has_no_label():
    for seed in range(200):
        sent, labels = inject_kinds(Kind.MISS, seed=seed, truth=drive(n=12), samples=(7, 20))
        if 0 < len(sent.t_s) < 12:
            assert len(labels) == (sent.t_s[0] == 0.0 and sent.t_s[-1] == 1.1)


def test_consistent_and_single_lies_go_together():
    _, labels = inject_kinds(Kind.DRAG, Kind.SHORT)
    assert {label.kind for label in labels} == {Kind.DRAG, Kind.SHORT}
    assert {label.sensor for label in labels if label.kind is Kind.DRAG} == {Sensor.BOTH}


def test_a_vehicle_lies_alike_in_any_company_and_by_its_seed():
    assert inject_kinds(Kind.NOISE)[1] == inject_kinds(Kind.NOISE)[1]
    assert inject_kinds(Kind.NOISE)[1] != inject_kinds(Kind.NOISE, seed=2)[1]
    assert inject_kinds(Kind.NOISE)[1] != inject_kinds(Kind.NOISE, truth=drive("b"))[1]


def test_share_is_the_part_of_vehicles_that_lie():
    misbehaving = sum(bool(inject_kinds(Kind.NOISE, share=0.3, truth=drive(f"v{i}", n=300))[1]) for i in range(300))
    assert misbehaving == pytest.approx(300 * 0.3 * (1 - 0.99**600), rel=0.25)


def test_without_an_injection_the_silences_of_the_recording_remain():
    t_s = np.arange(N) / 10 + np.where(np.arange(N) >= 600, 2.0, 0.0)
    truth = drive(t_s=t_s)
    sent, (label,) = corrupt(truth, 1, None)
    assert sent is truth
    assert (label.kind, label.start_us, label.stop_us) == (Kind.MISS, 59_900_000, 62_000_000)


def test_a_speed_below_zero_is_told_upwards_by_as_much():
    true, sent = np.array([0.0, 1.0, 5.0, 100.0]), np.array([-2.0, -0.5, 4.0, 200.0])
    assert np.allclose(sendable_speed(true, sent), [2.0, 2.5, 4.0, 163.8])
