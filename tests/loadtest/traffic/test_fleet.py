import numpy as np

from headway_loadtest.inject.faults import Kind, Sensor, Spec
from headway_loadtest.traffic.fleet import COHORT, FleetFrames


def columns(frames, name):
    return np.concatenate([getattr(frame, name) for frame in frames])


def test_ten_messages_a_second_from_each_in_order():
    frames = list(FleetFrames(50, 3.0, seed=1))
    assert np.array_equal(np.bincount(columns(frames, "row")), np.full(50, 30))
    assert np.all(np.diff(columns(frames, "t_us")) >= 0)


def test_other_rates():
    frames = list(FleetFrames(50, 3.0, seed=1, step_ms=50))
    assert np.array_equal(np.bincount(columns(frames, "row")), np.full(50, 60))


def test_large_fleets_take_turns_and_stay_in_order():
    frames = list(FleetFrames(3 * COHORT, 0.3, seed=1))
    t_us = columns(frames, "t_us")
    assert np.all(np.diff(t_us) >= 0)
    per_ms = np.bincount(t_us // 1000, minlength=300)
    assert per_ms.max() < 4 * per_ms.mean()
    assert np.array_equal(np.bincount(columns(frames, "row")), np.full(3 * COHORT, 3))


def test_a_burst_is_everyone_at_once():
    t_us = columns(FleetFrames(2 * COHORT, 0.3, seed=1, burst=True), "t_us")
    assert np.array_equal(np.unique(t_us), [0, 100_000, 200_000])


def test_a_share_of_the_fleet_lies_and_the_labels_say_when():
    spec = Spec(kinds=(Kind.BIAS,), c=100.0, p=0.05, share=0.1)
    source, honest = FleetFrames(200, 10.0, seed=4, inject=spec), FleetFrames(200, 10.0, seed=4)
    faults, truth = list(source), list(honest)
    differs = columns(faults, "speed_mps") != columns(truth, "speed_mps")
    rows, steps = columns(faults, "row"), columns(faults, "t_us") // 100_000
    faulty = set(rows[differs].tolist())
    assert 8 <= len(faulty) <= 35
    labelled = np.zeros_like(differs)
    for label in source.labels:
        if label.sensor is Sensor.SPEED:
            row = int(label.vehicle.removeprefix("syn-"))
            labelled |= (rows == row) & (steps >= label.start_us // 100_000) & (steps < label.stop_us // 100_000)
    assert np.array_equal(differs, labelled)
    assert honest.labels == []


def test_a_silent_vehicle_sends_nothing_and_its_counter_waits():
    source = FleetFrames(30, 60.0, seed=2, inject=Spec(kinds=(Kind.MISS,), p=0.02))
    frames = list(source)
    rows, counts = columns(frames, "row"), columns(frames, "msg_cnt")
    assert len(rows) < 30 * 600
    for row in range(30):
        mine = counts[rows == row]
        assert np.array_equal(mine, np.arange(len(mine)) % 128)
    label = source.labels[0]
    sent_us = columns(frames, "t_us")[rows == int(label.vehicle.removeprefix("syn-"))]
    assert np.diff(sent_us)[np.searchsorted(sent_us, label.start_us + 100_000) - 1] > 700_000


def test_identifiers_rotate_at_times_of_their_own():
    frames = list(FleetFrames(20, 10.0, seed=1, rotate_s=4.0))
    names = [vehicle.id for frame in frames for vehicle in frame.entering]
    assert len(frames[0].entering) == 20
    assert len(names) == len(set(names))
    assert 20 * 3 <= len(names) <= 20 * 4
    assert max(len(frame.entering) for frame in frames[1:]) <= 2


def test_identifiers_stay_unless_they_rotate():
    frames = list(FleetFrames(20, 10.0, seed=1))
    assert sum(len(frame.entering) for frame in frames) == 20
