"""Algorithm 1 on positions and speeds: sizes, labels, and what stays as it was."""

from dataclasses import replace

import numpy as np
import pytest
from loadtest.evaluate.field.made import driving

from headway_loadtest.evaluate.field.degradations import with_jumps
from headway_loadtest.evaluate.field.faults import with_faults
from headway_loadtest.evaluate.field.recordings import local_m
from headway_loadtest.inject.faults import Kind, Sensor


def difference(before, after):
    """Metres along the heading (north), metres across, and m/s, message by message."""
    (north, east), (north_0, east_0) = (local_m(one.messages, 45.0, 9.0) for one in (after, before))
    return north - north_0, east - east_0, after.messages["speed_mps"] - before.messages["speed_mps"]


def test_what_is_labelled_is_changed_and_nothing_else():
    clean = driving(seconds=600.0)
    faulty, faults = with_faults(clean, 1.0, 0, 0)
    along, across, mps = difference(clean, faulty)
    assert {fault.sensor for fault in faults} == {Sensor.LOCATION, Sensor.SPEED}
    t_us = clean.messages["t_us"]
    for sensor, change in ((Sensor.LOCATION, along), (Sensor.SPEED, mps)):
        labelled = np.zeros(len(t_us), bool)
        for fault in faults:
            if fault.sensor is sensor:
                labelled |= (t_us >= fault.start_us) & (t_us <= fault.stop_us)
        changed = np.abs(change) > 1e-4
        assert not (changed & ~labelled).any()
        assert changed[labelled].mean() > 0.95
    assert np.abs(across).max() < 1e-3


@pytest.mark.parametrize("c", [1.0, 0.1])
def test_noise_and_bias_have_the_variance_asked_for(c):
    clean = driving(seconds=20_000.0)
    faulty, faults = with_faults(clean, c, 3, 0)
    along, _, mps = difference(clean, faulty)
    t_us = clean.messages["t_us"]
    sizes = {Kind.NOISE: [], Kind.BIAS: []}
    for fault in faults:
        if fault.kind in sizes:
            at = slice(*np.searchsorted(t_us, [fault.start_us, fault.stop_us + 1]))
            change = (along if fault.sensor is Sensor.LOCATION else mps)[at]
            sizes[fault.kind] += change.tolist() if fault.kind is Kind.NOISE else [change[0]]
    for kind, values in sizes.items():
        n = len(values)
        assert n > 300
        assert np.var(values) == pytest.approx(c, rel=5 * np.sqrt(2 / n)), kind


def test_a_fault_of_one_message_is_a_short():
    _, faults = with_faults(driving(seconds=3000.0), 1.0, 0, 0)
    assert all((fault.kind is Kind.SHORT) == (fault.start_us == fault.stop_us) for fault in faults)
    assert any(fault.kind is Kind.SHORT for fault in faults)


def test_no_speed_is_below_zero_and_the_seed_decides():
    slow = driving(seconds=600.0, mps=0.2)
    one, again, other, run = (
        with_faults(slow, 1.0, seed, run)[0].messages["speed_mps"] for seed, run in ((0, 0), (0, 0), (1, 0), (0, 1))
    )
    assert one.min() >= 0.0
    assert (one == again).all()
    assert (one != other).any()
    assert (one != run).any()


def test_a_vehicle_without_messages_has_no_faults():
    recording = driving(seconds=600.0, vehicles=("a", "b"))
    recording = replace(recording, messages=recording.messages[recording.messages["vehicle"] == 0])
    faulty, faults = with_faults(recording, 1.0, 0, 0)
    assert {fault.vehicle for fault in faults} == {"a"}
    jumping, jumps = with_jumps(recording, 0, 0, along=False)
    assert {jump.vehicle for jump in jumps} == {"a"}
    assert len(faulty.messages) == len(jumping.messages) == 6000
