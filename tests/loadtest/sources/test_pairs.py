import csv

import numpy as np
import pytest
from geographiclib.geodesic import Geodesic

from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.pairs import COLUMNS, Pairs, read_pair

HEADER = ",".join(COLUMNS)
ROWS = ("0.0,30.0,10.0,9.0,8.0,4.5", "0.1,30.9,10.8,9.0,8.0,4.5", "0.2,31.8,11.6,9.0,8.0,4.5")


def write(tmp_path, *lines, name="pair.csv"):
    path = tmp_path / name
    path.write_text("\n".join(lines) + "\n")
    return path


def test_both_cars_are_vehicles_on_one_road(tmp_path):
    leader, follower = read_pair(write(tmp_path, HEADER, *ROWS))
    assert leader.vehicle.endswith("pair-leader")
    assert follower.vehicle.endswith("pair-follower")
    assert leader.length_m == 4.5
    assert follower.length_m is None
    gap_m = Geodesic.WGS84.Inverse(leader.lat[0], leader.lon[0], follower.lat[0], follower.lon[0])["s12"]
    assert gap_m == pytest.approx(20.0, abs=1e-2)


def test_time_starts_at_zero(tmp_path):
    later = [f"{float(row.split(',')[0]) + 77.0},{row.split(',', 1)[1]}" for row in ROWS]
    leader, _ = read_pair(write(tmp_path, HEADER, *later))
    assert np.allclose(leader.t_s, [0.0, 0.1, 0.2])


def test_pairs_have_roads_of_their_own(tmp_path):
    paths = [write(tmp_path, HEADER, *ROWS, name=f"pair_{i}.csv") for i in range(2)]
    (first, _), (second, _) = Pairs(paths)
    apart_m = Geodesic.WGS84.Inverse(first.lat[0], first.lon[0], second.lat[0], second.lon[0])["s12"]
    assert apart_m > 1000.0
    assert first.vehicle != second.vehicle


@pytest.mark.parametrize(
    ("lines", "problem"),
    [
        ((HEADER,), "no rows below the header"),
        (("t_s,leader_x_m", "0,1"), "row 1: no column follower_x_m"),
        ((HEADER, ROWS[0], "0.1,30.9,abc,9.0,8.0,4.5"), "row 3: follower_x_m is 'abc', not a number"),
        ((HEADER, ROWS[0], "0.1,30.9,,9.0,8.0,4.5"), "row 3: follower_x_m is '', not a number"),
        ((HEADER, ROWS[0], "0.1,30.9,inf,9.0,8.0,4.5"), "row 3: follower_x_m is 'inf', not a number"),
        ((HEADER, ROWS[1], ROWS[0]), "row 3: t_s does not increase"),
        ((HEADER, ROWS[0], "0.1,5.0,10.8,9.0,8.0,4.5"), "row 3: the leader is not ahead of the follower"),
        ((HEADER, "0.0,30.0,10.0,-9.0,8.0,4.5"), "row 2: a speed is below 0"),
        ((HEADER, ROWS[0], "0.1,1e17,10.8,9.0,8.0,4.5"), "row 3: the leader is over 1,000 km ahead"),
        ((HEADER, "0.0,30.0,10.0,9.0,8.0,0"), "row 2: leader_length_m is not above 0"),
    ],
)
def test_a_bad_file_gets_one_line_with_file_row_and_problem(tmp_path, lines, problem):
    path = write(tmp_path, *lines)
    with pytest.raises(SourceError) as caught:
        read_pair(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert problem in str(caught.value)
    assert "\n" not in str(caught.value)


def test_ragged_and_binary_files_are_refused(tmp_path):
    for content in (f"{HEADER}\n1,2\n".encode(), f"{HEADER}\n{ROWS[0]},1,2\n".encode(), b"\x00\xff\xfe" * 50, b""):
        path = tmp_path / "bad.csv"
        path.write_bytes(content)
        with pytest.raises(SourceError, match=r"bad\.csv: "):
            read_pair(path)


def test_real_pairs_come_out_as_they_are_in_the_file(shared_data):
    path = shared_data / "pairs" / "jiang" / "pair_101.csv"
    with path.open() as file:
        rows = list(csv.DictReader(file))
    leader, follower = read_pair(path)
    assert len(leader.t_s) == len(rows)
    for i in (0, 1, len(rows) // 2, len(rows) - 1):
        assert leader.speed_mps[i] == float(rows[i]["leader_v_mps"])
        assert follower.speed_mps[i] == float(rows[i]["follower_v_mps"])
        assert follower.x_m[i] == float(rows[i]["follower_x_m"])


def test_every_real_pair_is_read(shared_data):
    paths = sorted((shared_data / "pairs").glob("*/*.csv"))
    vehicles = [drive.vehicle for scene in Pairs(paths) for drive in scene]
    assert len(set(vehicles)) == 2 * len(paths) > 0
