import numpy as np
import pytest

from headway_loadtest.traffic.schedule import TICK_NS, Schedule

NOW_NS, NOW_US = 5_000_000_000, 1_700_000_000_000_000


def schedule(**options):
    return Schedule(start_ns=NOW_NS, start_unix_us=NOW_US, **options)


def test_at_speed_1_a_whole_millisecond_is_sent_at_its_event_time():
    t_us = np.array([0, 1000, 57_000, 3_600_000_000])
    assert np.array_equal(schedule().due_ns(t_us), NOW_NS + 1000 * t_us)
    assert np.array_equal(schedule().event_us(t_us), NOW_US + t_us)


def test_others_are_sent_within_the_millisecond_after():
    t_us = np.array([1, 999, 1001])
    assert np.array_equal(schedule().due_ns(t_us) - NOW_NS, [TICK_NS, TICK_NS, 2 * TICK_NS])


def test_faster_replays_begin_in_the_past_and_end_at_now():
    fast = schedule(speed=10.0, span_s=100.0)
    assert fast.first_event_us == NOW_US - 90_000_000
    last_us = np.array([100_000_000])
    assert fast.due_ns(last_us)[0] == NOW_NS + 10_000_000_000
    assert fast.event_us(last_us)[0] == NOW_US + 10_000_000


def test_an_event_time_leads_back_to_the_send_time():
    for speed, span_s in ((1.0, 0.0), (4.0, 60.0)):
        at = schedule(speed=speed, span_s=span_s)
        t_us = np.array([12_345_000])
        assert at.due_of_event_ns(int(at.event_us(t_us)[0])) == at.due_ns(t_us)[0]
        assert at.event_at_us(int(at.due_ns(t_us)[0])) == pytest.approx(at.event_us(t_us)[0], abs=1000 * speed)


@pytest.mark.parametrize("speed", [0.0, -1.0, float("nan"), float("inf")])
def test_speed_is_above_0(speed):
    with pytest.raises(ValueError, match="speed is a factor above 0"):
        schedule(speed=speed)
