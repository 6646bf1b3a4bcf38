import numpy as np
import pytest

from headway_loadtest.sources.synthetic import PLATOON, STEP_MS, Fleet, SyntheticDrives, drives

METRES_PER_DEGREE = 111_000.0
STEP_S = STEP_MS / 1000


def steps(count, *args, **kwargs):
    fleet = Fleet(*args, **kwargs)
    return [fleet.step() for _ in range(count)]


def test_the_same_seed_drives_the_same_way():
    once, again, other = (steps(20, 30, seed) for seed in (4, 4, 5))
    for a, b in zip(once, again, strict=True):
        assert all(np.array_equal(x, y) for x, y in zip(a, b, strict=True))
    assert not np.array_equal(once[-1].x_m, other[-1].x_m)


def test_nobody_collides_or_reverses_in_ten_minutes():
    fleet = Fleet(200, 1)
    follower = np.arange(200) % PLATOON != 0
    leader = np.arange(200) - 1
    smallest_m, stood = np.inf, False
    for _ in range(6000):
        readings = fleet.step()
        gap_m = readings.x_m[leader[follower]] - readings.x_m[follower] - fleet.length_m[leader[follower]]
        smallest_m = min(smallest_m, float(gap_m.min()))
        stood |= bool((readings.speed_mps < 0.3).any())
        assert readings.speed_mps.min() >= 0.0
    assert smallest_m > 0.2
    assert stood, "traffic must also stop and go"


def test_sensors_err_as_real_ones_do():
    columns = steps(600, 300, 3, window_ms=(0, 0))
    x_m = np.array([readings.x_m for readings in columns])
    v_mps = np.array([readings.speed_mps for readings in columns])
    mismatch_m = np.diff(x_m, axis=0) - STEP_S * (v_mps[1:] + v_mps[:-1]) / 2
    assert np.std(mismatch_m - mismatch_m.mean(axis=0)) == pytest.approx(0.008, rel=0.1)
    offset_mps = -mismatch_m.mean(axis=0) / STEP_S
    assert 0.01 < np.abs(offset_mps).max() < 0.08


def test_positions_move_as_the_vehicle_does():
    columns = steps(100, 40, 3)
    lat = np.array([readings.lat for readings in columns])
    lon = np.array([readings.lon for readings in columns])
    x_m = np.array([readings.x_m for readings in columns])
    east_m = np.diff(lon, axis=0) * METRES_PER_DEGREE * np.cos(np.radians(42.1))
    moved_m = np.hypot(np.diff(lat, axis=0) * METRES_PER_DEGREE, east_m)
    assert np.allclose(moved_m, np.abs(np.diff(x_m, axis=0)), atol=0.05)


def test_each_reads_at_its_own_time_within_the_window():
    columns = steps(50, 1000, 2, window_ms=(20, 40))
    t_ms = np.array([readings.t_ms for readings in columns]) - 100 * np.arange(50)[:, None]
    assert t_ms.min() == 20
    assert t_ms.max() == 39
    assert np.all(np.ptp(t_ms, axis=0) <= 4)
    assert len(np.unique(t_ms[0])) == 20


@pytest.mark.parametrize("step_ms", [20, 50, 200])
def test_other_rates_drive_and_read_alike(step_ms):
    columns = steps(60_000 // step_ms, 200, 3, step_ms=step_ms, window_ms=(0, 0))
    speeds = np.array([readings.speed_mps for readings in columns])
    assert 5.0 < speeds.mean() < 15.0
    assert columns[1].t_ms[0] - columns[0].t_ms[0] == step_ms
    accel_mps2 = np.diff(speeds, axis=0) / (step_ms / 1000)
    assert np.quantile(np.abs(accel_mps2), 0.5) < 3.0


def test_an_empty_window_is_everyone_at_once():
    assert np.all(steps(1, 100, 2, window_ms=(0, 0))[0].t_ms == 0)


def test_platoons_and_fleets_never_meet():
    first, second = steps(1, 40, 2)[0], steps(1, 40, 2, first=40)[0]
    lat, lon = np.concatenate([first.lat, second.lat]), np.concatenate([first.lon, second.lon])
    platoon = np.arange(80) // PLATOON
    apart_m = np.hypot(lat[:, None] - lat, (lon[:, None] - lon) * np.cos(np.radians(42.1))) * METRES_PER_DEGREE
    assert apart_m[platoon[:, None] != platoon].min() > 200.0


def test_drives_are_the_fleet_by_vehicle():
    scenes = list(SyntheticDrives(23, 5.0, 9))
    assert [len(scene) for scene in scenes] == [10, 10, 3]
    assert len({drive.vehicle for scene in scenes for drive in scene}) == 23
    columns = steps(50, 3, 9, first=20)
    assert np.array_equal(scenes[2][1].speed_mps, [readings.speed_mps[1] for readings in columns])
    assert np.all(np.diff(scenes[0][0].t_s) > 0)


def test_followers_respond_to_the_car_ahead():
    (leader, follower, *_) = drives(5, 120.0, 1)
    assert np.corrcoef(leader.speed_mps[:-15], follower.speed_mps[15:])[0, 1] > 0.8
