from itertools import pairwise

import numpy as np
import pytest

from headway_loadtest.inject.faults import MISS_SAMPLES_MIN, Kind, Sensor, Spec, SpecError, inject

N = 200_000


def injected(seed=1, n=N, **spec):
    return inject(np.random.default_rng(seed), np.zeros(n), np.zeros(n), Spec(**spec))


def only(kind, **spec):
    return injected(kinds=(kind,), **spec)


def lengths(corrupted):
    return np.array([event.stop - event.start for event in corrupted.events if event.stop < N])


def test_algorithm_1_makes_a_twentieth_of_each_sensor_anomalous():
    corrupted = injected()
    expected = 0.005 * 10.5 / (1 + 0.005 * 9.5)  # mean duration over mean cycle; the first wait may be 0
    for codes in (corrupted.x_kind, corrupted.v_kind):
        assert np.mean(codes != Kind.NONE) == pytest.approx(expected, rel=0.08)


def test_sensors_are_hit_independently():
    corrupted = injected()
    x, v = corrupted.x_kind != Kind.NONE, corrupted.v_kind != Kind.NONE
    assert np.mean(x & v) == pytest.approx(x.mean() * v.mean(), rel=0.3)
    assert np.array_equal(corrupted.anomalous, x | v)


def test_kinds_and_durations_are_uniform():
    corrupted = injected()
    kinds = np.array([event.kind for event in corrupted.events])
    for kind in (Kind.NOISE, Kind.BIAS, Kind.DRIFT):
        assert np.mean(kinds == kind) == pytest.approx(1 / 3, abs=0.04)
    durations = lengths(corrupted)
    assert (durations.min(), durations.max()) == (1, 20)
    assert durations.mean() == pytest.approx(10.5, abs=0.5)


def test_c_is_the_variance_of_noise_and_bias():
    for kind in (Kind.NOISE, Kind.BIAS):
        corrupted = only(kind, c=4.0, p=0.05)
        first = [corrupted.x_m[event.start] for event in corrupted.events if event.sensor is Sensor.LOCATION]
        assert np.var(first) == pytest.approx(4.0, rel=0.08)


def test_noise_is_drawn_for_each_sample_and_bias_once():
    noise, bias = only(Kind.NOISE), only(Kind.BIAS)
    for corrupted, distinct in ((noise, True), (bias, False)):
        for event in corrupted.events:
            if event.sensor is Sensor.SPEED and event.stop - event.start > 1:
                assert (np.ptp(corrupted.v_mps[event.start : event.stop]) > 0) == distinct


def test_drift_is_a_ramp_of_either_sign_to_at_most_c():
    corrupted = only(Kind.DRIFT, c=3.0)
    ends = []
    for event in corrupted.events:
        if event.sensor is Sensor.LOCATION and event.stop < N:
            ramp = corrupted.x_m[event.start : event.stop]
            ends.append(ramp[-1])
            if len(ramp) > 1:
                assert np.allclose(ramp, np.linspace(0.0, ramp[-1], len(ramp)))
    assert np.abs(ends).max() <= 3.0
    assert np.mean(np.abs(ends)) == pytest.approx(1.5, rel=0.1)
    assert np.mean(np.sign(ends)) == pytest.approx(0.0, abs=0.1)


def test_every_event_changes_a_reading():
    corrupted = injected(p=0.05, samples=(1, 3))
    for event in corrupted.events:
        reading = corrupted.x_m if event.sensor is Sensor.LOCATION else corrupted.v_mps
        assert np.any(reading[event.start : event.stop] != 0.0)


def test_readings_outside_events_are_untouched():
    corrupted = injected()
    assert np.all(corrupted.x_m[corrupted.x_kind == Kind.NONE] == 0.0)
    assert np.all(corrupted.v_mps[corrupted.v_kind == Kind.NONE] == 0.0)


def test_events_of_a_sensor_never_overlap():
    corrupted = injected(p=0.5)
    for sensor in (Sensor.LOCATION, Sensor.SPEED):
        events = [event for event in corrupted.events if event.sensor is sensor]
        assert all(a.stop <= b.start for a, b in pairwise(events))


def test_short_lasts_one_sample_whatever_the_range():
    assert set(lengths(only(Kind.SHORT, samples=(5, 9)))) == {1}


def test_miss_silences_both_sensors_longer_than_congestion_control_does():
    corrupted = only(Kind.MISS)
    assert not corrupted.present.all()
    assert np.all((corrupted.x_kind == Kind.MISS) == ~corrupted.present)
    assert np.array_equal(corrupted.x_kind, corrupted.v_kind)
    assert {event.sensor for event in corrupted.events} == {Sensor.LINK}
    assert lengths(corrupted).min() == MISS_SAMPLES_MIN


def test_an_event_nobody_can_hear_has_no_label():
    corrupted = injected(p=0.2, kinds=(Kind.SHORT, Kind.MISS))
    for event in corrupted.events:
        if event.kind is Kind.SHORT:
            assert corrupted.present[event.start]


def test_same_seed_same_events_and_the_arguments_stay():
    truth = np.arange(5000.0)
    once = inject(np.random.default_rng(7), truth, truth, Spec())
    again = inject(np.random.default_rng(7), truth, truth, Spec())
    assert once.events == again.events
    assert np.array_equal(once.x_m, again.x_m)
    assert np.array_equal(truth, np.arange(5000.0))
    assert once.events != inject(np.random.default_rng(8), truth, truth, Spec()).events


def test_an_event_at_the_end_is_cut():
    corrupted = injected(n=50, p=0.5)
    assert max(event.stop for event in corrupted.events) <= 50


def test_p_of_zero_injects_nothing():
    assert injected(p=0.0).events == ()


def test_consistent_kinds_are_refused():
    with pytest.raises(SpecError, match="drag falsifies location and speed together"):
        only(Kind.DRAG)
