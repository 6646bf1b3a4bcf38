"""Each attack changes what its name says, within its published parameters, and marks the messages that matter."""

import numpy as np
import pytest
from loadtest.evaluate.field.made import S, driving

from headway_loadtest.evaluate.field.attacks import ATTACKS, CATCH, Context
from headway_loadtest.evaluate.field.recordings import local_m


@pytest.fixture
def forge():
    """Return a function from an attack's name to the true and the forged messages of a car at 10 m/s."""

    def made(name, mps=10.0, seed=0):
        recording = driving(seconds=60.0, mps=mps, vehicles=("a", "b"))
        track, other = recording.tracks
        other["speed_mps"] += 0.5
        track["accel_mps2"] = np.tile([1.0, 0.0, -1.0], len(track))[: len(track)]
        return track.copy(), ATTACKS[name](Context(np.random.default_rng(seed), other), track)

    return made


def off_m(true, forged):
    return np.stack(local_m(forged.messages, 45.0, 9.0)) - np.stack(local_m(true, 45.0, 9.0))


def test_the_published_attacks_are_all_there():
    assert CATCH.keys() <= ATTACKS.keys()


@pytest.mark.parametrize("name", ["constant-position-offset", "random-position-offset"])
def test_position_offsets(forge, name):
    off = off_m(*forge(name))
    assert np.abs(off).min() > 19.9
    assert np.abs(off).max() < 70.1
    assert (np.ptp(off, axis=1) < 0.1).all() == name.startswith("constant")


@pytest.mark.parametrize("name", ["constant-position", "random-position"])
def test_false_places(forge, name):
    true, forged = forge(name)
    places = np.stack(local_m(forged.messages, 45.0, 9.0))
    assert np.abs(places).max() < 851.0
    assert (np.ptp(places, axis=1) < 1e-3).all() == name.startswith("constant")
    assert forged.malicious.all()
    assert (forged.messages["speed_mps"] == true["speed_mps"]).all()


def test_mirroring_is_to_the_left_of_the_road(forge):
    north, east = off_m(*forge("position-mirroring"))
    assert np.abs(north).max() < 0.01
    assert -14.01 < east.min() <= east.max() < -5.99


@pytest.mark.parametrize(
    ("name", "least", "most", "constant"),
    [
        ("constant-speed", 0.0, 40.0, True),
        ("random-speed", 0.0, 40.0, False),
        ("constant-speed-offset", 3.0, 17.0, True),
        ("random-speed-offset", 3.0, 17.0, False),
        ("zero-speed", 0.0, 0.0, True),
    ],
)
def test_speeds(forge, name, least, most, constant):
    true, forged = forge(name)
    sent = forged.messages["speed_mps"]
    assert least <= sent.min() <= sent.max() <= most
    assert (np.ptp(sent) == 0.0) == constant
    assert (forged.malicious == (np.abs(sent - 10.0) >= 1.0)).all()
    assert (forged.messages["lat_deg"] == true["lat_deg"]).all()


def test_an_offset_of_5_mps_and_no_speed_below_zero(forge):
    signs = {float(forge("speed-offset-5mps", seed=seed)[1].messages["speed_mps"][0]) for seed in range(20)}
    assert signs == {5.0, 15.0}
    for seed in range(20):
        assert forge("speed-offset-5mps", mps=2.0, seed=seed)[1].messages["speed_mps"].min() >= 0.0


def test_zero_speed_of_a_car_that_stands_is_no_attack(forge):
    assert not forge("zero-speed", mps=0.3)[1].malicious.any()
    assert not forge("reversed-heading", mps=0.3)[1].malicious.any()


def test_a_sudden_constant_speed_counts_where_it_is_off(forge):
    recording = driving(seconds=60.0)
    track = recording.messages
    track["speed_mps"] += 0.01 * np.arange(len(track))
    true = track["speed_mps"].copy()
    forged = ATTACKS["sudden-constant-speed"](Context(np.random.default_rng(0), track[:0]), track)
    held = int(np.flatnonzero(forged.messages["speed_mps"] != true)[0]) - 1
    assert (forged.messages["speed_mps"][held:] == true[held]).all()
    assert np.flatnonzero(forged.malicious)[0] == pytest.approx(held + 100, abs=1)


def test_a_sudden_stop_freezes_place_and_speed(forge):
    true, forged = forge("sudden-stop")
    at = int(np.flatnonzero(forged.malicious)[0])
    assert forged.malicious[at:].all()
    assert (forged.messages["speed_mps"][at:] == 0.0).all()
    assert (forged.messages["lat_deg"][at:] == true["lat_deg"][at]).all()
    assert (forged.messages["lat_deg"][:at] == true["lat_deg"][:at]).all()


def test_headings_are_reversed(forge):
    assert (forge("reversed-heading")[1].messages["heading_deg"] == 180.0).all()


def test_a_replay_takes_runs_of_one_vehicle_of_the_last_seconds(forge):
    true, forged = forge("replay")
    replayed = forged.messages["speed_mps"] == 10.5
    assert (replayed == forged.malicious).all()
    assert replayed.mean() > 0.95
    age_s = -off_m(true, forged)[0][replayed] / 10.0
    assert age_s.min() > -0.81  # a run goes on with what the victim sent next
    assert age_s.max() < 5.01
    runs = np.diff(np.flatnonzero(np.abs(np.diff(off_m(true, forged)[0])) > 0.01))
    assert runs.max() <= 8


def test_disruption_takes_any_message_of_ten_seconds(forge):
    true, forged = forge("disruptive")
    age_s = -off_m(true, forged)[0][forged.malicious] / 10.0
    assert age_s.min() > 0.0
    assert 9.0 < age_s.max() <= 10.01


def test_a_delay_moves_time_stamps_only(forge):
    true, forged = forge("time-delay")
    later = np.unique(forged.messages["t_us"] - true["t_us"])
    assert later.size == 1
    assert 2 * S <= later[0] <= 4 * S
    assert (forged.messages["lat_deg"] == true["lat_deg"]).all()


def test_accelerations(forge):
    true, forged = forge("feigned-braking")
    factor = forged.messages["accel_mps2"][true["accel_mps2"] > 0]
    assert -4.0 <= factor.min() <= factor.max() <= -2.0
    assert (forged.malicious == (true["accel_mps2"] > 0)).all()
    true, forged = forge("acceleration-multiplication")
    assert (forged.malicious == (true["accel_mps2"] != 0)).all()


@pytest.mark.parametrize(("name", "rate"), [("dos", (2, 4)), ("dos-random", (4, 4)), ("dos-disruptive", (4, 4))])
def test_floods_send_more_often(forge, name, rate):
    true, forged = forge(name)
    times = len(forged.messages) / len(true)
    assert rate[0] <= times <= rate[1]
    assert np.diff(forged.messages["t_us"]) == pytest.approx(100_000 / times, abs=1)
    assert forged.malicious.all()
    if name == "dos":
        assert (forged.messages["lat_deg"] == np.repeat(true["lat_deg"], int(times))).all()


def test_phantoms_drive_around_the_vehicle_and_its_own_messages_stay(forge):
    true, forged = forge("congestion-sybil")
    own = forged.pseudonym == 0
    np.testing.assert_array_equal(forged.messages[own].view("i8"), true.view("i8"))
    assert (forged.malicious == ~own).all()
    count = int(forged.pseudonym.max())
    assert 4 <= count <= 6
    for number in range(1, count + 1):
        phantom = forged.messages[forged.pseudonym == number]
        north, east = np.stack(local_m(phantom, 45.0, 9.0)) - np.stack(local_m(true, 45.0, 9.0))
        assert 2.99 <= np.abs(north[0]) <= 8.01
        assert 1.99 <= np.abs(east[0]) <= 3.01
        assert phantom["speed_mps"][0] / 10.0 == pytest.approx(1.0, abs=0.0501)


def test_random_sybils_take_their_pseudonyms_in_turn(forge):
    _, forged = forge("dos-random-sybil")
    assert forged.pseudonym[:6].tolist() == [1, 2, 3, 4, 5, 1]
