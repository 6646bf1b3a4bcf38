import pytest

from headway_loadtest.inject.apply import Label
from headway_loadtest.inject.faults import Kind, Sensor
from headway_loadtest.measure.detection import GRACE_US, assess
from headway_loadtest.measure.subscriber import Episode
from headway_loadtest.traffic.schedule import Schedule
from headway_schemas import Kind as AlertKind
from headway_schemas import Sensor as StatedSensor

S = 1_000_000
SCHEDULE = Schedule(start_ns=0, start_unix_us=0)


def label(vehicle="a", start_s=10.0, stop_s=12.0, kind=Kind.BIAS):
    return Label(vehicle, Sensor.SPEED, kind, int(start_s * S), int(stop_s * S))


def episode(suspect="a", onset_s=10.5, last_s=None, kind=AlertKind.BIAS, leader=None, follower=None, received_s=None):
    onset_us = int(onset_s * S)
    return Episode(
        event_id=f"{suspect}-{onset_s}",
        received_ns=round((onset_s if received_s is None else received_s) * 1e9),
        kind=kind,
        sensor=StatedSensor.SPEED,
        suspect=suspect,
        leader=leader,
        follower=follower or suspect,
        onset_us=onset_us,
        last_us=onset_us if last_s is None else int(last_s * S),
    )


def assessed(labels, episodes, last_us=None, hours=2.0):
    return assess(labels, episodes, schedule=SCHEDULE, last_us=last_us or {"a": 100 * S}, vehicle_hours=hours)


def test_an_event_is_found_with_its_delay_and_its_name():
    quality = assessed([label()], [episode(received_s=10.7)])
    score = quality.by_kind["bias"]
    assert (score.events, score.found, score.named) == (1, 1, 1)
    assert score.delay_s == pytest.approx(0.7)
    assert (quality.right, quality.false_alarms) == (1, 0)


def test_an_event_nobody_noticed_is_not_found():
    quality = assessed([label()], [])
    assert (quality.events, quality.found) == (1, 0)
    assert quality.by_kind["bias"].delay_s is None


@pytest.mark.parametrize(("onset_s", "found", "false_alarms"), [(9.9, 0, 1), (10.0, 1, 0), (12.9, 1, 0), (13.1, 0, 1)])
def test_only_an_onset_within_the_event_or_shortly_after_counts(onset_s, found, false_alarms):
    assert GRACE_US == S
    quality = assessed([label()], [episode(onset_s=onset_s)])
    assert (quality.found, quality.false_alarms) == (found, false_alarms)


def test_an_alarm_that_never_ends_finds_nothing():
    quality = assessed([label()], [episode(onset_s=3.0, last_s=99.0)])
    assert (quality.found, quality.false_alarms) == (0, 1)


def test_one_episode_can_cover_two_events():
    labels = [label(), label(start_s=11.0, stop_s=14.0, kind=Kind.DRIFT)]
    quality = assessed(labels, [episode(onset_s=10.5, last_s=13.0)])
    assert (quality.found, quality.right, quality.false_alarms) == (2, 1, 0)
    assert quality.by_kind["drift"].named == 0


def test_the_neighbour_of_a_liar_is_blamed_by_name():
    quality = assessed([label("a")], [episode("b", leader="a"), episode("c", follower="a")])
    assert (quality.found, quality.wrong_vehicle, quality.false_alarms) == (0, 2, 0)


def test_a_vehicle_that_has_left_is_neither_right_nor_wrong():
    quality = assessed([], [episode(kind=AlertKind.MISS, onset_s=100.0)])
    assert (quality.departures, quality.false_alarms) == (1, 0)
    quality = assessed([], [episode(kind=AlertKind.MISS, onset_s=50.0)])
    assert (quality.departures, quality.false_alarms) == (0, 1)


def test_who_has_dragged_his_location_lies_ever_after():
    quality = assessed([label(kind=Kind.DRAG)], [episode(onset_s=60.0, kind=AlertKind.RANGE)])
    assert (quality.found, quality.false_alarms) == (0, 0)
    quality = assessed([label(kind=Kind.DRAG)], [episode(onset_s=11.0, kind=AlertKind.RESPONSE)])
    assert quality.by_kind["drag"].named == 1


def test_false_alarms_are_told_by_the_hour():
    quality = assessed([], [episode(onset_s=1.0), episode(onset_s=5.0)], hours=4.0)
    assert quality.false_alarms_per_vehicle_hour == 0.5
    assert assessed([], [], hours=0.0).false_alarms_per_vehicle_hour == 0.0
