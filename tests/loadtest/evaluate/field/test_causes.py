"""Recordings with one thing wrong each: the cause that an alarm there is counted under."""

import numpy as np
import pytest
from loadtest.evaluate.field.made import alarm, driving

from headway_loadtest.evaluate.field.causes import facts_of
from headway_loadtest.evaluate.field.recordings import move


def jump(track):
    shift = np.zeros(len(track))
    shift[300:] = 4.0
    move(track, shift)


def frozen(track):
    track["speed_mps"] += 0.1 * np.sin(np.arange(len(track)))
    track["speed_mps"][295:340] = 4.0


def repeated(track):
    track["speed_mps"] += 0.1 * np.sin(np.arange(len(track)))
    for name in ("lat_deg", "lon_deg"):
        track[name][300] = track[name][299]


@pytest.mark.parametrize(
    ("change", "cause"),
    [(lambda _track: None, "none"), (jump, "position-jump"), (frozen, "frozen-speed"), (repeated, "repeated-position")],
)
def test_the_cause_is_what_the_recording_shows_at_the_onset(change, cause):
    recording = driving()
    change(recording.messages)
    assert facts_of(recording)["a"].cause(alarm(30.2, 33.0)) == cause


def test_gap_comes_first_and_a_miss_after_the_last_message_is_the_end_of_the_track():
    recording = driving(gap_after_s=30.0)
    facts = facts_of(recording)["a"]
    assert facts.cause(alarm(26.5, 28.0)) == facts.cause(alarm(36.5, 38.0)) == "recording-gap"
    assert facts.cause(alarm(59.9, None, kind="miss")) == "end-of-track"


@pytest.mark.parametrize(("mps", "cause"), [(0.2, "standstill"), (2.0, "low-speed")])
def test_slow_driving_is_a_cause(mps, cause):
    assert facts_of(driving(mps=mps))["a"].cause(alarm(30.0, 33.0)) == cause


def test_hard_braking_is_a_cause():
    recording = driving()
    track = recording.messages
    track["speed_mps"][300:325] -= 0.4 * np.arange(25)
    assert facts_of(recording)["a"].cause(alarm(30.5, 33.0)) == "hard-braking"
