"""Hand-made attackers and events: shares of messages, attackers and suspects from the definitions alone."""

from dataclasses import replace

import numpy as np
import pytest
from loadtest.evaluate.field.made import S, alarm, detection, driving

from headway_loadtest.evaluate.field import misbehaviour
from headway_loadtest.evaluate.field.detection import EventUpdate
from headway_loadtest.evaluate.field.recordings import T0_US


@pytest.fixture
def attacked():
    """Two cars for a minute; `a` attacks from 30 s on."""
    recording = driving(vehicles=("a", "b"))
    own = recording.messages["vehicle"] == 0
    late = recording.messages["t_us"] >= T0_US + 30 * S
    return misbehaviour.Attacked(recording, own & late, ~own, {"a": "a"})


def test_a_message_is_found_while_an_open_event_names_its_sender(attacked):
    made = misbehaviour.score(attacked, detection(alarm(35.0, 50.0)))
    assert (made.malicious, made.found) == (300, 151)
    assert (made.honest, made.false_positives) == (600, 0)
    assert (made.attackers, made.attackers_named, made.events, made.suspect_right) == (1, 1, 1, 1)
    assert (made.cars, made.cars_named) == (1, 0)


def test_an_event_that_is_never_cleared_is_open_to_the_end(attacked):
    assert misbehaviour.score(attacked, detection(alarm(35.0, None))).found == 250


def test_an_event_that_names_an_honest_car_is_a_false_positive(attacked):
    made = misbehaviour.score(attacked, detection(alarm(35.0, 40.0, suspect="b")))
    assert (made.found, made.false_positives, made.attackers_named, made.cars_named) == (0, 51, 0, 1)
    assert made.events == 0


def test_the_newest_update_says_whom_an_event_names(attacked):
    said = replace(alarm(35.0, 50.0, kind="response"), follower="b", leader="a")
    said.updates[1:1] = [EventUpdate(T0_US + 40 * S, "response", "both", "b", True)]
    made = misbehaviour.score(attacked, detection(said))
    assert (made.found, made.false_positives) == (51, 101)
    assert (made.events, made.suspect_right) == (1, 0)


def test_misses_cover_no_message_but_name_a_car(attacked):
    made = misbehaviour.score(attacked, detection(alarm(35.0, 40.0, kind="miss", suspect="b")))
    assert (made.false_positives, made.cars_named) == (0, 1)


def test_attackers_are_a_fifth_and_begin_at_birth_or_in_the_middle():
    recording = driving(seconds=30.0, vehicles=tuple("abcdefghij"))
    for onset, (least, most) in {"birth": (0.0, 0.0), "mid": (0.4, 0.6)}.items():
        made = misbehaviour.attack(recording, "random-position", onset, 0, 0)
        attackers = np.unique(made.recording.messages["vehicle"][made.malicious])
        assert len(attackers) == len(made.owner) == 2
        for which in attackers:
            own = made.malicious[made.recording.messages["vehicle"] == which]
            assert least * 300 - 1 <= np.flatnonzero(own)[0] <= most * 300
            assert own[np.flatnonzero(own)[0] :].all()
        honest = ~np.isin(made.recording.messages["vehicle"], attackers)
        assert (made.honest == honest).all()
    other = misbehaviour.attack(recording, "random-position", "birth", 1, 0)
    again = misbehaviour.attack(recording, "random-position", "mid", 0, 0)
    assert (again.recording.messages["lat_deg"] == made.recording.messages["lat_deg"]).all()
    assert (other.recording.messages["lat_deg"] != made.recording.messages["lat_deg"]).any()


def test_pseudonyms_are_vehicles_of_their_own_that_belong_to_the_attacker():
    recording = driving(seconds=30.0, vehicles=("a", "b"))
    made = misbehaviour.attack(recording, "congestion-sybil", "birth", 0, 0)
    (attacker,) = set(made.owner.values())
    assert set(made.recording.vehicles) == {"a", "b"} | made.owner.keys()
    assert 4 <= len(made.owner) - 1 <= 6
    for which, name in enumerate(made.recording.vehicles):
        own = made.recording.messages["vehicle"] == which
        assert own.sum() == 300
        counts = made.recording.messages["msg_cnt"][own]
        assert ((np.diff(counts) % 128) == 1).all() or name == next(iter({"a", "b"} - {attacker}))
        assert made.malicious[own].all() == (name != attacker and name in made.owner)


def test_the_row_stands_beside_the_published_figure_where_there_is_one():
    total = misbehaviour.AttackScore(malicious=4, found=3, honest=10, false_positives=1)
    row = misbehaviour.row("sumo-highway-idm-0.3m", "zero-speed", "birth", total)
    assert (row["message_recall"], row["false_positive_rate"]) == (0.75, 0.1)
    assert (row["catch_message_recall"], row["catch_false_positive_rate"]) == (0.93, 0.12)
    assert misbehaviour.row("cats", "zero-speed", "birth", total)["catch_message_recall"] is None
    assert misbehaviour.row("sumo-urban-idm-0.3m", "zero-speed", "mid", total)["catch_message_recall"] is None
