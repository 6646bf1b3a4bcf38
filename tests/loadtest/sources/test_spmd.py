import csv

import numpy as np
import pytest

from headway_loadtest.sources.drive import SourceError
from headway_loadtest.sources.spmd import HOST_COLUMNS, TARGET_COLUMNS, SpmdTrips

GENUINE = [
    ("sp1day_DataWsu_04_11_13.csv", "sp1day_DataFrontTargets_04_11_13.csv"),
    ("sp2month_DataWsu.csv", "sp2month_DataFrontTargets.csv"),
]


def host_row(time, *, device=1, trip=1, gps=1, can=1, speed_kmh=36.0, lat=42.3, lon=-83.7, heading=90.0):
    given = {
        "Device": device,
        "Trip": trip,
        "Time": time,
        "GpsValidWsu": gps,
        "ValidCanWsu": can,
        "LatitudeWsu": lat,
        "LongitudeWsu": lon + 1.2132e-6 * time,
        "GpsHeadingWsu": heading,
        "SpeedWsu": speed_kmh,
    }
    return ",".join(str(given.get(column, 0)) for column in HOST_COLUMNS)


def target_row(time, *, device=1, trip=1, obstacle=3, range_m=20.0, rate_mps=-1.5, kind=0, cipv=1):
    return f"{device},{trip},{time},1,{obstacle},{range_m},{rate_mps},-0.3,{kind},3,{cipv}"


def tables(tmp_path, hosts, targets, header=TARGET_COLUMNS, encoding="utf-8"):
    host_path, targets_path = tmp_path / "a_DataWsu.csv", tmp_path / "a_DataFrontTargets.csv"
    host_path.write_text("\n".join([",".join(HOST_COLUMNS), *hosts]) + "\n")
    targets_path.write_text("\n".join([",".join(header), *targets]) + "\n", encoding=encoding)
    return SpmdTrips(host_path, targets_path)


def test_units_and_the_leader_rule(tmp_path):
    times = range(0, 50, 10)
    (scene,) = tables(tmp_path, map(host_row, times), map(target_row, times))
    host, leader = scene
    assert np.allclose(host.t_s, [0.0, 0.1, 0.2, 0.3, 0.4])
    assert np.allclose(host.speed_mps, 10.0)
    assert np.allclose(leader.speed_mps, 36.0 / 3.6 - 1.5)
    assert np.allclose(leader.x_m, host.x_m + 20.0)
    assert host.ahead is not None
    assert host.ahead.ids == (leader.vehicle,)
    assert np.allclose(host.ahead.range_m, 20.0)
    assert np.allclose(host.ahead.range_rate_mps, -1.5)


def test_the_leader_is_ahead_on_the_earth(tmp_path):
    times = range(0, 500, 10)
    (scene,) = tables(tmp_path, map(host_row, times), map(target_row, times))
    host, leader = scene
    metres_per_degree = 111_320.0 * np.cos(np.radians(42.3))
    assert np.allclose((leader.lon - host.lon) * metres_per_degree, 20.0, atol=0.2)


@pytest.mark.parametrize(
    ("kind", "cipv", "leads"), [(0, 1, True), (1, 1, True), (2, 1, True), (3, 1, False), (4, 1, False), (0, 0, False)]
)
def test_who_is_a_leader(tmp_path, kind, cipv, leads):
    times = range(0, 50, 10)
    (scene,) = tables(tmp_path, map(host_row, times), [target_row(t, kind=kind, cipv=cipv) for t in times])
    assert (len(scene) == 2) is leads


def test_another_obstacle_or_a_jump_in_time_is_another_leader(tmp_path):
    times = [*range(0, 100, 10), *range(200, 300, 10)]
    targets = [target_row(t, obstacle=3 if t < 50 else 4) for t in times]
    (scene,) = tables(tmp_path, map(host_row, times), targets)
    host, *leaders = scene
    assert [len(leader.t_s) for leader in leaders] == [5, 5, 10]
    assert host.ahead is not None
    assert host.ahead.which.tolist() == [0] * 5 + [1] * 5 + [2] * 10


def test_no_target_no_leader_for_that_while(tmp_path):
    times = range(0, 100, 10)
    (scene,) = tables(tmp_path, map(host_row, times), [target_row(t) for t in times if t < 40])
    host, leader = scene
    assert host.ahead is not None
    assert host.ahead.which.tolist() == [0] * 4 + [-1] * 6
    assert len(leader.t_s) == 4


def test_trips_are_scenes_and_each_has_its_own_targets(tmp_path):
    hosts = [host_row(t, device=d, trip=p) for d, p in ((2, 1), (1, 7), (1, 8)) for t in range(0, 50, 10)]
    targets = [target_row(t, device=1, trip=8) for t in range(0, 50, 10)]
    scenes = list(tables(tmp_path, hosts, targets))
    assert [scene[0].vehicle for scene in scenes] == ["spmd-2-1", "spmd-1-7", "spmd-1-8"]
    assert [len(scene) for scene in scenes] == [1, 1, 2]


def test_bad_rows_and_repeated_times_are_left_out(tmp_path):
    hosts = [
        host_row(0),
        host_row(10, gps=0),
        host_row(20, can=0),
        host_row(30),
        host_row(30),
        host_row(40, lat="NULL"),
    ]
    (scene,) = tables(tmp_path, hosts, [])
    assert np.allclose(scene[0].t_s, [0.0, 0.3])


def test_the_other_spelling_with_a_byte_order_mark(tmp_path):
    header = [name.replace("RangeRate", "Rangerate") for name in TARGET_COLUMNS]
    times = range(0, 50, 10)
    trips = tables(tmp_path, map(host_row, times), map(target_row, times), header=header, encoding="utf-8-sig")
    assert len(next(iter(trips))) == 2


def test_without_targets_the_host_drives_alone(tmp_path):
    trips = tables(tmp_path, map(host_row, range(0, 50, 10)), [])
    (scene,) = SpmdTrips(trips.host_path, None)
    assert scene[0].ahead is None


def test_a_missing_column_and_a_word_for_a_number_are_named(tmp_path):
    trips = tables(tmp_path, [host_row(0)], [target_row(0)], header=["Device", "Trip", "Time"])
    with pytest.raises(SourceError, match=r"a_DataFrontTargets\.csv: "):
        list(trips)
    bad = tables(tmp_path, [host_row(0, speed_kmh="fast")], [])
    with pytest.raises(SourceError, match=r"a_DataWsu\.csv: .*fast") as caught:
        list(bad)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(("host_name", "targets_name"), GENUINE)
def test_genuine_files_come_out_in_si_units(shared_data, host_name, targets_name):
    folder = shared_data / "spmd_fixtures"
    with (folder / host_name).open(encoding="utf-8-sig") as file:
        rows = list(csv.DictReader(file))
    ((host, *_), *_) = SpmdTrips(folder / host_name, folder / targets_name)
    assert host.vehicle == f"spmd-{rows[0]['Device']}-{rows[0]['Trip']}"
    assert len(host.t_s) == len(rows)
    for i, row in enumerate(rows):
        assert host.t_s[i] == pytest.approx((int(row["Time"]) - int(rows[0]["Time"])) / 100)
        assert host.speed_mps[i] == pytest.approx(float(row["SpeedWsu"]) / 3.6)
        assert host.lat[i] == pytest.approx(float(row["LatitudeWsu"]), abs=1e-5)
        assert host.lon[i] == pytest.approx(float(row["LongitudeWsu"]), abs=1e-5)


@pytest.mark.parametrize(("_", "targets_name"), GENUINE)
def test_genuine_targets_are_joined_to_their_host(shared_data, tmp_path, _, targets_name):
    targets_path = shared_data / "spmd_fixtures" / targets_name
    with targets_path.open(encoding="utf-8-sig") as file:
        rows = list(csv.reader(file))[1:]
    device, trip = rows[0][:2]
    hosts = [host_row(int(row[2]), device=device, trip=trip) for row in rows]
    host_path = tables(tmp_path, hosts, []).host_path
    ((host, leader),) = SpmdTrips(host_path, targets_path)
    assert host.ahead is not None
    assert np.allclose(host.ahead.range_m, [float(row[5]) for row in rows])
    assert np.allclose(leader.speed_mps, [10.0 + float(row[6]) for row in rows])
