"""Simulated traffic: true readings that agree with each other, and the same ones for the same seed."""

from importlib.util import find_spec

import numpy as np
import pytest

from headway_loadtest.evaluate.field import sumo
from headway_loadtest.evaluate.field.recordings import local_m
from headway_loadtest.sources import sumo as programs
from headway_loadtest.sources.drive import SourceError

needs_sumo = pytest.mark.skipif(find_spec("sumo") is None, reason="eclipse-sumo is not installed: headway[sumo]")


@needs_sumo
@pytest.mark.parametrize("scenario", sumo.SCENARIOS)
def test_true_positions_move_as_true_speeds_say(scenario):
    truth = sumo.simulate(scenario, "EIDM", 0.5, 7)
    assert truth.group == f"sumo-{scenario}-eidm"
    assert len(truth.vehicles) > 10
    speeds = truth.messages["speed_mps"]
    assert speeds.max() < (18.0 if scenario == "urban" else 42.0)
    off = []
    for track in truth.tracks:
        assert (np.diff(track["t_us"]) == 100_000).all()
        assert track["msg_cnt"].tolist() == [k % 128 for k in range(len(track))]
        north, east = local_m(track, sumo.ORIGIN_LAT, sumo.ORIGIN_LON)
        step_m = np.hypot(np.diff(north), np.diff(east))
        off.append(step_m - 0.05 * (track["speed_mps"][1:] + track["speed_mps"][:-1]))
    assert np.abs(np.concatenate(off)).max() < 0.03
    assert np.quantile(np.abs(np.concatenate(off)), 0.99) < 0.01


@needs_sumo
def test_the_seed_decides_and_receivers_add_their_error():
    one, again, other = (list(sumo.recordings("sumo:urban-idm", 0.5, seed)) for seed in (3, 3, 4))
    assert [recording.group for recording in one] == ["sumo-urban-idm-0.3m", "sumo-urban-idm-0.5m"]
    for left, right in zip(one, again, strict=True):
        np.testing.assert_array_equal(left.messages.view("i8"), right.messages.view("i8"))
    assert len(one[0].messages) != len(other[0].messages)
    fine, coarse = one
    assert (fine.messages["lat_deg"] != coarse.messages["lat_deg"]).all()


def test_names_give_scenarios_and_drivers():
    assert sumo.names() == ("sumo:urban-idm", "sumo:urban-eidm", "sumo:highway-idm", "sumo:highway-eidm")
    with pytest.raises(SourceError, match="no such traffic; choose from sumo, sumo:urban-idm"):
        list(sumo.recordings("sumo:rural", 1.0, 0))


def test_without_sumo_the_message_says_what_to_install(monkeypatch):
    monkeypatch.setattr(programs, "find_spec", lambda _name: None)
    with pytest.raises(SourceError, match=r"install headway\[sumo\]"):
        list(sumo.recordings("sumo:urban-idm", 1.0, 0))
