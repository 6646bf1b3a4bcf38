"""Each degradation changes what its name says, by as much, and nothing else."""

import numpy as np
import pytest
from loadtest.evaluate.field.made import S, driving

from headway_loadtest.evaluate.field.degradations import DEGRADATIONS, JUMPS, degrade, with_jumps
from headway_loadtest.evaluate.field.recordings import local_m

SECONDS = 2000.0


@pytest.fixture(scope="module")
def clean():
    recording = driving(seconds=SECONDS)
    recording.messages["speed_mps"] += np.sin(np.arange(len(recording.messages)) / 30.0)
    return recording


def messages(clean, name, seed=0):
    return degrade(clean, name, seed, 0).messages


def off_m(clean, degraded):
    """(2, n) metres north and east of the true position, where every message is received."""
    return np.stack(local_m(degraded, 45.0, 9.0)) - np.stack(local_m(clean.messages, 45.0, 9.0))


@pytest.mark.parametrize("name", DEGRADATIONS)
def test_chance_depends_on_the_seed_and_the_true_recording_stays(clean, name):
    before = clean.messages.copy()
    one, again = messages(clean, name), messages(clean, name)
    np.testing.assert_array_equal(one.view("i8"), again.view("i8"))
    np.testing.assert_array_equal(clean.messages.view("i8"), before.view("i8"))
    assert len(one) != len(before) or (one.view("i8") != before.view("i8")).any()


def test_white_noise(clean):
    degraded = messages(clean, "white-0.1m-0.03mps")
    assert off_m(clean, degraded).std(axis=1) == pytest.approx(0.1, rel=0.03)
    assert (degraded["speed_mps"] - clean.messages["speed_mps"]).std() == pytest.approx(0.03, rel=0.03)


@pytest.mark.parametrize(("name", "std_m"), [("walk-1m", 1.0), ("walk-3m", 3.0)])
def test_walk(clean, name, std_m):
    off = np.concatenate([off_m(clean, messages(clean, name, seed)) for seed in range(20)])
    assert off.std() == pytest.approx(std_m, rel=0.1)
    assert np.diff(off).std() == pytest.approx(std_m * np.sqrt(2 * (1 - np.exp(-0.1 / 30.0))), rel=0.02)


def test_outages_last_five_seconds_about_a_minute_apart(clean):
    dt_s = np.diff(messages(clean, "outage-5s")["t_us"]) / S
    gaps = dt_s[dt_s > 0.15]
    assert gaps == pytest.approx(5.1, abs=0.1)
    assert gaps.size == pytest.approx(SECONDS / 65.0, rel=0.4)


@pytest.mark.parametrize("name", ["position-1hz", "both-1hz"])
def test_held_readings_change_once_a_second(clean, name):
    degraded = messages(clean, name)
    moved = np.flatnonzero(np.diff(degraded["lat_deg"]) != 0.0)
    assert (np.diff(moved) == 10).all()
    sped = np.flatnonzero(np.diff(degraded["speed_mps"]) != 0.0)
    assert (len(sped) == len(moved)) == (name == "both-1hz")


@pytest.mark.parametrize(("name", "age_s"), [("position-age-0.1s", 0.1), ("position-age-0.5s", 0.5)])
def test_positions_are_older_than_speeds(clean, name, age_s):
    degraded = messages(clean, name)
    kept = np.isin(clean.messages["t_us"], degraded["t_us"])
    north = local_m(degraded, 45.0, 9.0)[0] - local_m(clean.messages[kept], 45.0, 9.0)[0]
    assert north == pytest.approx(-10.0 * age_s, abs=1e-3)
    assert (degraded["speed_mps"] == clean.messages["speed_mps"][kept]).all()


@pytest.mark.parametrize(("name", "std_s"), [("time-jitter-10ms", 0.01), ("time-jitter-30ms", 0.03)])
def test_time_stamps_scatter_and_stay_in_order(clean, name, std_s):
    degraded = messages(clean, name)
    off_s = (degraded["t_us"] - clean.messages["t_us"]) / S
    assert off_s.std() == pytest.approx(std_s, rel=0.2)
    assert np.abs(off_s).max() <= 0.045
    assert (np.diff(degraded["t_us"]) > 0).all()


@pytest.mark.parametrize(("name", "part"), [("speed-scale-1pct", 0.01), ("speed-scale-3pct", 0.03)])
def test_speed_scale(clean, name, part):
    off = messages(clean, name)["speed_mps"] / clean.messages["speed_mps"] - 1.0
    assert np.abs(off) == pytest.approx(part)
    assert np.ptp(off) < 1e-9


@pytest.mark.parametrize(
    ("name", "step_mps"),
    [("speed-step-0.1mps", 0.1), ("speed-step-0.25mph", 0.11176), ("speed-step-1kmh", 0.2777778)],
)
def test_speed_steps(clean, name, step_mps):
    sent = messages(clean, name)["speed_mps"]
    assert sent / step_mps == pytest.approx(np.round(sent / step_mps), abs=1e-5)
    assert np.abs(sent - clean.messages["speed_mps"]).max() <= 0.5 * step_mps + 1e-9


def test_one_position_in_ten_is_the_one_before(clean):
    degraded = messages(clean, "repeated-10pct")
    repeated = np.diff(degraded["lat_deg"]) == 0.0
    assert repeated.mean() == pytest.approx(0.1, rel=0.1)
    late = np.round(-off_m(clean, degraded)[0]).astype(int)
    assert np.bincount(late)[:3] / late.size == pytest.approx([0.9, 0.09, 0.009], rel=0.2)


def test_losses(clean):
    n = len(clean.messages)
    assert len(messages(clean, "loss-30pct")) == pytest.approx(0.7 * n, rel=0.03)
    gaps = np.diff(messages(clean, "loss-bursts-of-5")["t_us"]) / 100_000
    assert set(np.round(gaps).astype(int).tolist()) == {1, 6}


@pytest.mark.parametrize("name", JUMPS)
def test_jumps_are_5_to_10_m_for_1_to_5_s_and_labelled(clean, name):
    recording, jumps = with_jumps(clean, 0, 0, along=JUMPS[name])
    off = off_m(clean, recording.messages)
    size, t_us = np.hypot(*off), clean.messages["t_us"]
    labelled = np.zeros(len(t_us), bool)
    for jump in jumps:
        inside = (t_us >= jump.start_us) & (t_us <= jump.stop_us)
        assert size[inside].min() >= 5.0
        assert size[inside].max() <= 10.02  # a plane over 20 km
        assert 0.8 <= (jump.stop_us - jump.start_us) / S <= 5.0
        labelled |= inside
    assert size[~labelled].max() < 1e-3
    assert len(jumps) == pytest.approx(SECONDS / 33.0, rel=0.4)
    across = np.abs(off[1][labelled]).max()
    assert (across < 1e-2) if JUMPS[name] else (across > 4.0)
