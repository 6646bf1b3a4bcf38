import csv

import numpy as np
import pytest

from headway_loadtest.sources.bsm_p1 import HEADER, BsmP1
from headway_loadtest.sources.drive import SourceError


def row(time_us, *, sender=7, file_id=1, lat=42.3, lon=-83.7, speed=10.0, heading=0.0):
    given = {
        "RxDevice": 5,
        "FileId": file_id,
        "TxDevice": sender,
        "GenTime": 300_000_000_000_000 + time_us,
        "Latitude": lat + 9e-11 * time_us,
        "Longitude": lon,
        "Speed": speed,
        "Heading": heading,
    }
    return ",".join(str(given.get(column, 0)) for column in HEADER)


def table(tmp_path, *rows, header=True):
    path = tmp_path / "x_BsmP1_y.csv"
    path.write_text("\n".join([*([",".join(HEADER)] if header else []), *rows]) + "\n")
    return BsmP1(path)


@pytest.mark.parametrize("header", [True, False])
def test_with_and_without_header(tmp_path, header):
    ((drive,),) = table(tmp_path, row(0), row(100_000), row(200_000), header=header)
    assert np.allclose(drive.t_s, [0.0, 0.1, 0.2])
    assert np.allclose(drive.speed_mps, 10.0)
    assert drive.vehicle == "bsm-7-1"


def test_senders_of_one_log_share_a_scene_and_its_clock(tmp_path):
    (scene,) = table(tmp_path, row(0, sender=7), row(50_000, sender=8), row(100_000, sender=7), row(150_000, sender=8))
    assert [drive.vehicle for drive in scene] == ["bsm-7-1", "bsm-8-1"]
    assert np.allclose(scene[1].t_s, [0.05, 0.15])


def test_logs_are_scenes(tmp_path):
    assert len(list(table(tmp_path, row(0, file_id=1), row(0, file_id=2)))) == 2


def test_unavailable_values_and_copies_are_left_out(tmp_path):
    ((drive,),) = table(
        tmp_path,
        row(0),
        row(0),
        row(100_000, speed=163.82),
        row(200_000, heading=360.0),
        row(300_000, lat=90.0000001),
        row(400_000),
    )
    assert np.allclose(drive.t_s, [0.0, 0.4])


def test_an_absent_file_is_named(tmp_path):
    with pytest.raises(SourceError, match=r"nowhere\.csv: No such file"):
        list(BsmP1(tmp_path / "nowhere.csv"))


@pytest.mark.parametrize("name", ["sp1day_BsmP1_04_11_13_02_20_14_01.csv", "sp2month_april_BsmP1.csv"])
def test_genuine_files(shared_data, name):
    path = shared_data / "spmd_fixtures" / name
    with path.open() as file:
        rows = [dict(zip(HEADER, line, strict=True)) for line in csv.reader(file) if line[0] != HEADER[0]]
    ((drive,),) = BsmP1(path)
    assert len(drive.t_s) == len(rows)
    for i, line in enumerate(rows):
        assert drive.t_s[i] == pytest.approx((int(line["GenTime"]) - int(rows[0]["GenTime"])) / 1e6)
        assert drive.speed_mps[i] == float(line["Speed"])
        assert drive.heading_deg[i] == float(line["Heading"])
        assert drive.lat[i] == pytest.approx(float(line["Latitude"]), abs=1e-5)
