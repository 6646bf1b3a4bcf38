import numpy as np
import pytest
from core.plausibility.sender import Drive, cruise, observed

from headway.core.types.records import Sensor

BIRTH_S = 5.0
"""A fault from the first message on is observed within this time."""


def stands(judged, drive, sensor, since_s, until_s=np.inf):
    """Share of the messages in which the sensor is implausible."""
    window = (drive.t_s >= since_s) & (drive.t_s < until_s)
    return (judged["implausible"][window] & sensor != 0).mean()


def test_a_steady_drive_shows_nothing():
    assert not cruise(np.random.default_rng(0)).check()["observed"].any()


@pytest.mark.parametrize(
    "fault",
    [lambda v: v + 5.0, lambda v: 0.0 * v, lambda v: 2.237 * v, lambda v: 0.3 * v, lambda v: np.full_like(v, 5.7)],
)
def test_a_wrong_speed_from_the_first_message_stands_and_is_named(fault):
    drive = cruise(np.random.default_rng(1), v_mps=14.0)
    drive.v_mps = fault(drive.v_mps)
    judged = drive.check()
    assert stands(judged, drive, Sensor.SPEED, BIRTH_S) == 1.0
    assert not (judged["implausible"] & Sensor.LOCATION).any()


def test_an_odd_position_is_over_with_the_next_one():
    drive = cruise(np.random.default_rng(21))
    drive.north_m[150] += 50.0
    assert np.flatnonzero(drive.check()["observed"]).tolist() == [150]


def test_an_odd_speed_is_over_with_the_next_one():
    drive = cruise(np.random.default_rng(22))
    drive.v_mps[150] = 0.0
    assert np.flatnonzero(drive.check()["observed"]).tolist() == [150]


@pytest.mark.parametrize("v_mps", [0.0, 14.0])
def test_a_random_speed_is_found_in_motion_and_at_a_standstill(v_mps):
    rng = np.random.default_rng(2)
    drive = cruise(rng, v_mps=v_mps)
    drive.v_mps = np.maximum(drive.v_mps + rng.uniform(-7, 7, drive.t_s.size), 0)
    assert stands(drive.check(), drive, Sensor.SPEED, 1.0) > 0.98


@pytest.mark.parametrize("spread_m", [30.0, 850.0])
def test_random_positions_are_the_location(spread_m):
    rng = np.random.default_rng(3)
    drive = cruise(rng)
    drive.east_m += rng.uniform(-spread_m, spread_m, drive.t_s.size)
    judged = drive.check()
    assert stands(judged, drive, Sensor.LOCATION, 1.0) == 1.0
    assert not (judged["implausible"] & Sensor.SPEED).any()


def test_positions_of_two_places_are_two_senders():
    drive = cruise(np.random.default_rng(4))
    drive.east_m[1::2] += 360.0
    judged = drive.check()
    assert stands(judged, drive, Sensor.LOCATION, 1.0) == 1.0
    assert "identity" in observed(judged)


def test_random_positions_are_no_two_senders():
    rng = np.random.default_rng(5)
    drive = cruise(rng)
    drive.east_m += rng.uniform(-300, 300, drive.t_s.size)
    assert "identity" not in observed(drive.check())


@pytest.mark.parametrize("jump_m", [5.0, 10.0, 100.0])
def test_a_jump_of_the_position_is_observed_once_and_passes(jump_m):
    drive = cruise(np.random.default_rng(6))
    drive.north_m[150:] += jump_m
    judged = drive.check()
    seen = judged["observed"] != 0
    assert seen[150]
    assert not seen[:150].any()
    assert not seen[220:].any()
    assert judged["implausible"][150] == Sensor.LOCATION


def test_a_position_that_stands_still_is_frozen():
    drive = cruise(np.random.default_rng(7))
    drive.east_m[:], drive.north_m[:] = 0.0, 0.0
    assert stands(drive.check(), drive, Sensor.LOCATION, BIRTH_S) == 1.0


def test_a_position_dragged_away_in_mid_drive_is_the_location():
    drive = cruise(np.random.default_rng(8))
    step = np.array([np.diff(drive.east_m[:2])[0], np.diff(drive.north_m[:2])[0]]) / 1.5
    away_m = 0.1 * np.cumsum(np.clip(drive.t_s - 15.0, 0.0, 6.0))
    drive.east_m += away_m * step[0]
    drive.north_m += away_m * step[1]
    judged = drive.check()
    first = np.flatnonzero(judged["observed"])[0]
    assert 150 < first < 220
    assert judged["implausible"][first] == Sensor.LOCATION


def test_a_speed_that_stops_to_dither_is_frozen_although_the_car_drives_so_fast():
    drive = cruise(np.random.default_rng(9), seconds=60.0, noise_mps=0.01)
    drive.v_mps[300:] = drive.v_mps[300]
    judged = drive.check()
    assert stands(judged, drive, Sensor.SPEED, 38.0) == 1.0
    assert not judged["observed"][:300].any()


@pytest.mark.parametrize("resolution_mps", [0.1, 1 / 3.6])
def test_a_coarse_speed_may_stand_still(resolution_mps):
    drive = cruise(np.random.default_rng(10), seconds=60.0)
    drive.v_mps = np.round(drive.v_mps / resolution_mps) * resolution_mps
    assert not drive.check()["observed"].any()


def test_a_stop_that_no_car_can_make_stands_until_it_drives_again():
    v = 15.0 + np.random.default_rng(11).normal(0, 0.02, 900)
    v[200:600] = 0.0
    v[600:] = np.minimum(2.0 * 0.1 * np.arange(300), 15.0)
    drive = Drive(np.random.default_rng(11), v)
    judged = drive.check()
    assert (judged["implausible"][200:590] != 0).all()
    assert "acceleration" in observed(judged)
    assert not judged["observed"][700:].any()


@pytest.mark.parametrize("decel_mps2", [8.0, 10.0])
def test_an_emergency_brake_shows_nothing(decel_mps2):
    v = np.full(300, 28.0)
    v[150:] = np.maximum(28.0 - decel_mps2 * 0.1 * np.arange(150), 0.0)
    assert not Drive(np.random.default_rng(12), v).check()["observed"].any()


@pytest.mark.parametrize("wrong_deg", [180.0, 100.0])
def test_a_heading_against_the_course_is_the_heading(wrong_deg):
    drive = cruise(np.random.default_rng(13))
    drive.heading_deg = (drive.heading_deg + wrong_deg) % 360
    judged = drive.check()
    assert stands(judged, drive, Sensor.HEADING, 2.0) == 1.0
    assert observed(judged) == {"heading"}


def test_a_heading_that_turns_too_fast_is_the_heading():
    rng = np.random.default_rng(14)
    drive = cruise(rng)
    drive.heading_deg = rng.uniform(0, 360, drive.t_s.size)
    assert stands(drive.check(), drive, Sensor.HEADING, 2.0) == 1.0


def test_a_car_that_reverses_shows_nothing():
    drive = Drive(np.random.default_rng(15), np.full(200, 2.5))
    drive.heading_deg = (drive.heading_deg + 180.0) % 360
    assert not drive.check()["observed"].any()


def test_a_hairpin_shows_nothing():
    v, turn = np.full(400, 6.0), np.zeros(400)
    turn[150:205] = 6.0 / 10.0
    assert not Drive(np.random.default_rng(16), v, turn).check()["observed"].any()


@pytest.mark.parametrize(("step_s", "too_fast"), [(0.1, False), (0.05, False), (0.02, True)])
def test_messages_that_come_too_fast_are_the_link(step_s, too_fast):
    drive = Drive(np.random.default_rng(17), np.full(1000, 15.0), step_s=step_s)
    judged = drive.check()
    assert ("interval" in observed(judged)) == too_fast
    assert (judged["implausible"][-1] == Sensor.LINK) == too_fast


def test_messages_of_one_time_that_differ_are_a_contradiction():
    drive = cruise(np.random.default_rng(18))
    drive.contradictions[[50, 100, 105]] = 1
    judged = drive.check()
    assert not judged["observed"][:105].any()
    assert judged["implausible"][105] == Sensor.LOCATION
    assert observed(judged) == {"contradiction"}
    assert not judged["observed"][180:].any()


@pytest.mark.parametrize(("v_mps", "too_fast"), [(69.0, False), (75.0, True)])
def test_a_speed_that_no_car_has_is_observed_at_once(v_mps, too_fast):
    drive = Drive(np.random.default_rng(19), np.full(20, v_mps))
    judged = drive.check()
    assert (judged["implausible"][0] == Sensor.SPEED) == too_fast
    assert judged["observed"].any() == too_fast


def test_what_stands_for_hours_is_not_learnt():
    drive = cruise(np.random.default_rng(20), seconds=3600.0)
    drive.v_mps += 5.0
    assert stands(drive.check(), drive, Sensor.SPEED, BIRTH_S) == 1.0


@pytest.mark.parametrize("swing_mps", [0.8, 0.95])
def test_a_speed_that_swings_faster_than_any_car_is_a_jerk(swing_mps):
    drive = cruise(np.random.default_rng(30))
    drive.v_mps += np.where(np.arange(drive.t_s.size) % 2, swing_mps, -swing_mps)
    judged = drive.check()
    assert observed(judged) == {"jerk"}
    assert stands(judged, drive, Sensor.SPEED, 2.0) == 1.0


@pytest.mark.parametrize("noise_mps", [0.05, 0.2, 0.3])
def test_noise_of_a_receiver_and_a_full_brake_to_rest_are_no_jerk(noise_mps):
    rng, t_s = np.random.default_rng(31), 0.1 * np.arange(300)
    decel_mps2 = np.clip(20.0 * (t_s - 10.0), 0.0, 8.0)
    drive = Drive(rng, np.maximum(15.0 - np.cumsum(decel_mps2) * 0.1, 0.0))
    drive.v_mps = np.maximum(drive.v_mps + rng.normal(0, noise_mps, t_s.size), 0.0)
    assert "jerk" not in observed(drive.check())


@pytest.mark.parametrize(("name", "sensor"), [("overlapped", Sensor.LOCATION), ("appeared", Sensor.LINK)])
def test_what_neighbours_and_coverage_show_stands_while_they_do(name, sensor):
    drive = cruise(np.random.default_rng(32))
    setattr(drive, name, ((drive.t_s >= 10.0) & (drive.t_s < 12.0)).astype(float))
    judged = drive.check()
    assert observed(judged) == {{"overlapped": "overlap", "appeared": "appearance"}[name]}
    assert stands(judged, drive, sensor, 10.0, 12.0) == 1.0
    assert not judged["observed"][drive.t_s >= 12.0].any()
