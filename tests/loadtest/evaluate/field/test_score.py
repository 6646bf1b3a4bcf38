"""Hand-made alarms and faults: the right counts, from the definitions alone."""

import pytest
from loadtest.evaluate.field.made import S, alarm, detection, driving, fault

from headway_loadtest.evaluate.field import score
from headway_loadtest.evaluate.field.causes import facts_of
from headway_loadtest.evaluate.field.detection import EventUpdate
from headway_loadtest.evaluate.field.recordings import T0_US
from headway_loadtest.inject.faults import Kind, Sensor


def recall(alarms, faults, clean=()):
    recording = driving()
    return score.fault_scores(facts_of(recording), faults, detection(*alarms), detection(*clean))[0]


@pytest.mark.parametrize(
    ("start_s", "cleared_s", "found"),
    [
        (20.0, 23.0, True),  # begins with the fault
        (22.9, 24.5, True),  # within the second of grace
        (23.1, 24.5, False),  # after it
        (18.0, 21.9, False),  # the last alarm is two seconds before it is cleared: before the fault
        (18.0, 22.1, True),
        (18.0, None, True),  # never cleared
    ],
)
def test_a_fault_is_found_by_an_alarming_reading_from_its_start_to_a_second_after_its_end(start_s, cleared_s, found):
    assert recall([alarm(start_s, cleared_s)], [fault(20.0, 21.9)]).found.total() == found


def test_an_alarm_of_another_car_or_a_miss_finds_nothing():
    assert recall([alarm(20.0, 23.0, suspect="b"), alarm(20.0, 23.0, kind="miss")], [fault(20.0, 21.0)]).found == {}


def test_sensor_and_kind_are_those_of_the_newest_update_up_to_the_end_of_the_window():
    said = alarm(20.0, 30.0, kind="short", sensor="location")
    said.updates[1:1] = [
        EventUpdate(T0_US + 21 * S, "bias", "speed", "a", True),
        EventUpdate(T0_US + 25 * S, "noise", "location", "a", True),
    ]
    made = recall([said], [fault(20.0, 21.0)])
    assert (made.sensor_right, made.kind_right) == (1, 1)
    assert made.confusion == {("bias", "bias"): 1}


def test_both_names_either_sensor_and_concurrent_faults_are_either_right():
    assert recall([alarm(20.0, 22.0, sensor="both")], [fault(20.0, 21.0)]).sensor_right == 1
    at_once = [fault(20.0, 21.0), fault(20.5, 20.5, kind=Kind.SHORT, sensor=Sensor.LOCATION)]
    made = recall([alarm(20.0, 23.0, kind="short", sensor="location")], at_once)
    assert (made.found.total(), made.sensor_right, made.kind_right) == (2, 2, 2)


def test_recall_by_chance_is_what_the_clean_alarms_would_have_found():
    faults = [fault(20.0, 21.0), fault(40.0, 41.0)]
    row = score.fault_row(recall([alarm(20.2, 22.0)], faults, clean=[alarm(10.0, 50.0)]))
    assert (row["recall"], row["recall_by_chance"], row["time_to_detect_s"]) == (0.5, 1.0, pytest.approx(0.2))


def test_false_alarms_leave_out_recorded_gaps_and_count_by_kind_cause_and_moment():
    recording = driving(gap_after_s=30.0, vehicles=("a", "b"))
    made = score.clean_score(
        facts_of(recording),
        detection(
            alarm(10.0, 12.0, observations=("heading", "speed_value")),
            alarm(14.0, 16.0, kind="drift", suspect="b"),
            alarm(34.0, 36.0),  # a second after the gap
            alarm(50.0, 52.0, kind="response", suspect="b"),
            pair_hours=0.5,
        ),
    )
    row = score.clean_row(made)
    assert row["vehicle_hours"] == pytest.approx(2 * (59.9 - 3.0) / 3600.0)
    assert row["false_alarms_by_kind"] == {"bias": 1, "drift": 1, "response": 1}
    assert row["false_alarms_by_cause"] == {"none": 3}
    assert row["false_alarms_by_observation"] == {"heading": 1, "speed_value": 1}
    assert row["alarms_at_recording_gaps"] == 1
    assert row["false_alarms_per_hour"] == pytest.approx(3 / row["vehicle_hours"])
    assert row["moments_per_hour"] == pytest.approx(2 / row["vehicle_hours"])
    assert row["link_false_alarms_per_pair_hour"] == 2.0
    assert (row["cars"], row["cars_named"]) == (2, 2)


def test_the_moving_slice_is_above_3_mps_and_4_s_away_from_gaps():
    slow, fast = facts_of(driving(mps=2.0))["a"], facts_of(driving(gap_after_s=30.0))["a"]
    assert slow.interval_h[slow.moving].sum() == 0.0
    assert fast.interval_h[fast.moving].sum() == pytest.approx((60.0 - 3.0 - 2 * 4.0) / 3600.0, abs=0.3 / 3600.0)
    assert [fast.is_moving(T0_US + t * S) for t in (20, 27, 36, 38)] == [True, False, False, True]


def test_scores_add_up():
    total = score.FaultScore()
    for _ in range(2):
        total += recall([alarm(20.0, 22.0)], [fault(20.0, 21.0)])
    assert (total.found, total.faults, total.delays_s) == ({"bias": 2}, {"bias": 2}, [0.0, 0.0])
