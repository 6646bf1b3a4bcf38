"""Files as they come: what is read from each form."""

import gzip
import json

import numpy as np
import pytest

from headway_loadtest.evaluate.field.recordings import DELAY_US, T0_US, course_deg, load, local_m
from headway_loadtest.sources.drive import SourceError

GNSS = """t_s,id,lat,lon,speed_mps,heading_deg,msg_cnt,accuracy_m,length_m,accel_mps2
0.100,b,45.0,9.0,10.0,90.0,7,0.5,4.5,0.1
0.000,a:1,45.1,9.1,0.0,,,,,
0.200,b,45.0,9.1,11.0,,8,0.5,4.5,
0.300,b,45.0,,11.0,,9,0.5,4.5,
"""


def only(path):
    (recording,) = load(path, 1, 0)
    return recording


def test_a_gnss_table_gives_messages_in_order_and_leaves_out_rows_without_a_position(tmp_path):
    (tmp_path / "town").mkdir()
    (tmp_path / "town" / "one.csv").write_text(GNSS)
    recording = only(tmp_path)
    assert (recording.group, recording.name, recording.run) == ("town", "one", None)
    messages = recording.messages
    names = [recording.vehicles[which] for which in messages["vehicle"]]
    assert names[1:] == ["b", "b"]
    assert messages["t_us"].tolist() == [T0_US, T0_US + 100_000, T0_US + 200_000]
    assert (messages["received_us"] - messages["t_us"]).tolist() == [DELAY_US] * 3
    assert messages["msg_cnt"].tolist() == [0, 7, 8]
    assert messages["accuracy_m"][1:].tolist() == [0.5, 0.5]
    assert np.isnan(messages["heading_deg"]).tolist() == [True, False, True]


def test_bsm_lines_keep_their_receive_time_and_unavailable_readings_are_left_out(tmp_path):
    bsm = {"v": 1, "id": "x", "msg_cnt": 3, "t_us": T0_US, "lat": 1.0, "lon": 2.0, "speed_mps": 3.0}
    lines = [bsm | {"received_us": T0_US + 7}, bsm | {"t_us": T0_US + 100_000, "heading_deg": None, "length_m": 5.0}]
    lines.append(bsm | {"t_us": T0_US + 200_000, "speed_mps": None})
    (tmp_path / "r.jsonl").write_text("\n".join(map(json.dumps, lines)))
    messages = only(tmp_path / "r.jsonl").messages
    assert messages["received_us"].tolist() == [T0_US + 7, T0_US + 100_000 + DELAY_US]
    assert messages["length_m"][1] == 5.0
    assert np.isnan(messages["heading_deg"]).all()


def test_a_pair_file_gives_two_cars_for_each_run_with_noise_of_their_own(tmp_path):
    rows = [f"{k / 10},{20 + k},{k},10.0,10.0,4.5" for k in range(400)]
    header = "t_s,leader_x_m,follower_x_m,leader_v_mps,follower_v_mps,leader_length_m"
    (tmp_path / "p.csv").write_text("\n".join([header, *rows]))
    one, other = load(tmp_path, 2, 0)
    assert (one.run, other.run, len(one.vehicles)) == (0, 1, 2)
    speeds = np.concatenate([one.messages["speed_mps"] - 10.0, other.messages["speed_mps"] - 10.0])
    assert speeds.std() == pytest.approx(0.01, rel=0.1)
    leader = one.tracks[0]
    north, east = local_m(leader, leader["lat_deg"][0], leader["lon_deg"][0])
    moved = np.hypot(np.diff(north), np.diff(east))
    assert moved.mean() == pytest.approx(1.0, rel=1e-3)


def test_the_course_fills_in_for_a_heading_that_is_absent(tmp_path):
    (tmp_path / "r.csv").write_text(
        "t_s,id,lat,lon,speed_mps\n" + "".join(f"{k},a,45,{9 + k * 1e-4},8\n" for k in range(9))
    )
    assert course_deg(only(tmp_path / "r.csv").tracks[0]) == pytest.approx(90.0, abs=0.01)


@pytest.mark.parametrize(
    ("name", "text", "said"),
    [
        ("a.csv", "t_s,id,lat\n0,a,1\n", "no column lon, speed_mps"),
        ("a.jsonl", '{"id":"a","lat":1,"lon":2,"speed_mps":3}\n', "line 1: not a BSM v1 record"),
        ("a.jsonl", "{", "a.jsonl: line 1: "),
        ("a.jsonl", "[1]", "line 1: not a BSM v1 record"),
        ("a.jsonl", "[" * 60_000, "line 1: not a BSM v1 record"),
        ("a.jsonl", '{"id":"a","lat":1,"lon":2,"speed_mps":3,"msg_cnt":1,"t_us":1e30}', "beyond 64 bits"),
        ("a.csv", "PAR1\udcff\udcfe", "no column t_s"),
        ("a.csv", "t_s,id\n\udcff,1\n", "not readable as CSV: "),
        ("a.parquet", "PAR1", "of no form that is recognised"),
        ("a.jsonl", "", "no records"),
    ],
)
def test_a_file_that_cannot_be_read_is_named(tmp_path, name, text, said):
    (tmp_path / name).write_text(text, errors="surrogateescape")
    with pytest.raises(SourceError, match=said):
        list(load(tmp_path / name, 1, 0))


def test_a_cut_archive_is_named(tmp_path):
    bsm = {"v": 1, "id": "x", "msg_cnt": 3, "t_us": T0_US, "lat": 1.0, "lon": 2.0, "speed_mps": 3.0}
    (tmp_path / "a.jsonl.gz").write_bytes(gzip.compress(f"{json.dumps(bsm)}\n".encode() * 999)[:-9])
    with pytest.raises(SourceError, match="ended before"):
        list(load(tmp_path / "a.jsonl.gz", 1, 0))


def test_an_empty_folder_is_named(tmp_path):
    with pytest.raises(SourceError, match="no recording"):
        list(load(tmp_path, 1, 0))
