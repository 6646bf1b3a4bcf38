import csv
import math
from pathlib import Path

import numpy as np
import pytest
from core.roads import START_US, STEP_S, STRAIGHT, Car, Noise, Reading, Road, World, drive, lat_lon

from headway.core.tracking.odometer import CRUMB_SPACING_M
from headway.core.tracking.tracks import CRUMB_EAST, CRUMB_X, CRUMBS, DEFAULT_LENGTH_M, evict, is_free
from headway.core.types.outcome import Outcome

ROW = np.array([0])
BEND = Road(((60.0, 0.0), (60.0 * math.pi / 2, 1 / 60.0), (1e5, 0.0)))
CROSSING = Road(((60.0, 0.0), (8.0 * math.pi / 2, -1 / 8.0), (1e5, 0.0)))


def receive(
    world: World,
    t_s: float,
    north_m: float = 0.0,
    *,
    east_m: float = 0.0,
    speed: float = 10.0,
    heading: float = 0.0,
    msg_cnt: int = 0,
    location_valid: bool = True,
) -> tuple[int, float, int, bool]:
    """One reading of row 0 through both passes: outcome, x_m, missed, began."""
    lat, lon = lat_lon(east_m, north_m)
    one = (np.array([value]) for value in (lat, lon, speed, heading))
    outcome, x_m, sequence_gaps, initialised = world.advance(ROW, START_US + round(t_s * 1e6), *one, msg_cnt=msg_cnt)
    if outcome[0] == Outcome.SCORED:
        world.extend_path_history(ROW, np.array([location_valid]), np.array([speed]))
    return int(outcome[0]), float(x_m[0]), int(sequence_gaps[0]), bool(initialised[0])


def test_on_a_straight_road_x_is_the_distance() -> None:
    record = drive(World(), [Car(STRAIGHT, lambda t: 20.0 * t)], 30.0)
    assert record.x_m[:, 0] == pytest.approx(20.0 * record.t_s, abs=1e-5)


@pytest.mark.parametrize(("road", "speed", "per_step_m"), [(BEND, 15.0, 0.002), (CROSSING, 6.0, 0.005)])
def test_in_a_bend_x_is_the_arc(road: Road, speed: float, per_step_m: float) -> None:
    """The step of x agrees with the speed as closely as a receiver's own (0.008 m), and nothing adds up."""
    record = drive(World(), [Car(road, lambda t: speed * t)], 30.0)
    assert np.diff(record.x_m[:, 0]) == pytest.approx(speed * STEP_S, abs=per_step_m)
    assert record.x_m[:, 0] == pytest.approx(speed * record.t_s, abs=0.03)


def test_in_a_bend_without_declared_heading_x_is_the_arc_within_centimetres() -> None:
    record = drive(World(), [Car(BEND, lambda t: 15.0 * t, declares_heading=False)], 30.0)
    assert np.diff(record.x_m[:, 0]) == pytest.approx(1.5, abs=0.02)
    assert record.x_m[-1, 0] == pytest.approx(15.0 * record.t_s[-1], abs=0.2)


def test_measured_noise_stays_measured_noise() -> None:
    """0.008 m of displacement against speed, drawn per axis, is 0.008 m of x against speed in the bend."""
    record = drive(World(), [Car(BEND, lambda t: 15.0 * t)], 30.0, noise=Noise(1))
    error = np.diff(record.x_m[:, 0]) - 1.5
    assert error.std() == pytest.approx(0.008, rel=0.2)


def test_an_outlier_leaves_nothing_behind() -> None:
    clean, spoiled = World(), World()
    for world in (clean, spoiled):
        for k in range(200):
            off = 80.0 if world is spoiled and k == 100 else 0.0
            _, x_m, _, _ = receive(world, k * STEP_S, k * 1.0 + off, east_m=off, location_valid=off == 0.0)
            if off:
                assert x_m == pytest.approx(180.0, abs=1e-3)
    assert spoiled.tracks["x_m"][0] == pytest.approx(clean.tracks["x_m"][0], abs=1e-6)
    assert spoiled.tracks["crumbs"][0, :, CRUMB_EAST] == pytest.approx(0.0, abs=1e-3)
    assert spoiled.tracks["heading_east"][0] == 0.0


def test_a_long_location_fault_shows_in_x_until_it_ends_and_not_after() -> None:
    """20 m ahead of the truth for 5 s, through the bend, and the base is carried on by the speed meanwhile."""

    def faulty(t_s: float) -> bool:
        return 8.0 < t_s < 13.0

    def spoil(_row: int, t_s: float, r: Reading) -> Reading:
        east, north = 20.0 * math.sin(math.radians(r[3])), 20.0 * math.cos(math.radians(r[3]))
        return (r[0] + north / 111_200.0, r[1] + east / 74_300.0, *r[2:]) if faulty(t_s) else r

    record = drive(
        World(), [Car(BEND, lambda t: 10.0 * t)], 20.0, noise=spoil, location_valid=lambda _row, t_s: not faulty(t_s)
    )
    error = record.x_m[:, 0] - 10.0 * record.t_s
    faulty_steps = np.array([faulty(t_s) for t_s in record.t_s])
    assert error[faulty_steps] == pytest.approx(20.0, abs=1.0)
    assert error[~faulty_steps] == pytest.approx(0.0, abs=0.2)


def test_a_wrong_heading_of_one_reading_turns_nothing_after_it() -> None:
    world = World()
    for k in range(100):
        receive(world, k * STEP_S, k * 1.0, heading=90.0 if k == 50 else 0.0, location_valid=k != 50)
    assert world.tracks["x_m"][0] == pytest.approx(99.0, abs=0.01)


def test_a_standing_car_keeps_its_heading() -> None:
    world = World()
    for k in range(50):
        receive(world, k * STEP_S, k * 1.0, heading=0.0)
    for k in range(50, 100):
        receive(world, k * STEP_S, 49.0, speed=0.1, heading=37.0 * k % 360.0)
    assert (world.tracks["heading_east"][0], world.tracks["heading_north"][0]) == (0.0, 1.0)


@pytest.mark.parametrize("parked_deg", [40.0, 140.0])
def test_a_heading_first_declared_in_motion_replaces_that_of_a_parked_car(parked_deg: float) -> None:
    world = World()
    for k in range(10):
        receive(world, k * STEP_S, speed=0.0, heading=parked_deg)
    for k in range(30):
        _, x_m, _, _ = receive(world, 1.0 + k * STEP_S, k * 1.0, heading=0.0)
    assert x_m == pytest.approx(29.0, abs=1e-3)


def test_without_declared_heading_a_noisy_start_is_no_lasting_direction() -> None:
    """It creeps off within the noise of its position, and no direction taken from that may stay."""

    def spoil(_row: int, t_s: float, r: Reading) -> Reading:
        rng = np.random.default_rng(round(t_s * 10))
        return r[0] + rng.normal(0.0, 0.3) / 111_200.0, r[1] + rng.normal(0.0, 0.3) / 74_300.0, r[2], r[3]

    car = Car(BEND, lambda t: 0.5 * t * t, declares_heading=False)
    record = drive(World(), [car], 20.0, noise=spoil)
    assert record.x_m[-1, 0] == pytest.approx(0.5 * record.t_s[-1] ** 2, abs=2.0)
    assert np.diff(record.x_m[100:, 0]) - record.v_mps[101:, 0] * STEP_S == pytest.approx(0.0, abs=1.5)


def test_a_speed_that_is_stuck_at_zero_does_not_bend_the_odometer() -> None:
    record = drive(World(), [Car(BEND, lambda t: 12.0 * t)], 20.0, noise=lambda _row, _t, r: (r[0], r[1], 0.0, r[3]))
    assert record.x_m[:, 0] == pytest.approx(12.0 * record.t_s, abs=0.1)


def test_a_copy_is_a_duplicate_another_content_a_contradiction_and_an_older_one_out_of_order() -> None:
    world = World()
    receive(world, 0.0, 0.0)
    receive(world, 0.1, 1.0, msg_cnt=1)
    before = world.tracks.tobytes()
    outcome, x_m, sequence_gaps, initialised = receive(world, 0.1, 50.0, msg_cnt=1)
    assert (outcome, sequence_gaps, initialised) == (Outcome.CONTRADICTION, 0, False)
    assert world.tracks["contradictions"][0] == 1
    world.tracks["contradictions"][0] = 0
    assert receive(world, 0.1, 1.0, msg_cnt=1)[0] == Outcome.DUPLICATE
    assert receive(world, 0.1, 1.0, msg_cnt=2)[0] == Outcome.OUT_OF_ORDER
    assert math.isnan(x_m)
    assert receive(world, 0.05, 0.5, msg_cnt=2)[0] == Outcome.OUT_OF_ORDER
    assert world.tracks.tobytes() == before


@pytest.mark.parametrize(
    ("t_s", "x_m", "counted"), [(0.5, 5.0, 0), (0.5, 8.0, 0), (0.5, 10.0, 1), (0.5, 0.0, 1), (0.95, 13.0, 1)]
)
def test_a_late_message_from_a_place_where_the_vehicle_was_not_is_a_contradiction(
    t_s: float, x_m: float, counted: int
) -> None:
    world = World()
    for k in range(10):
        receive(world, 0.1 * k, float(k))
    receive(world, 1.0, 10.0)
    assert receive(world, t_s, x_m)[0] == Outcome.OUT_OF_ORDER
    assert world.tracks["contradictions"][0] == counted


@pytest.mark.parametrize(
    ("counts", "steps", "sequence_gaps"),
    [
        ([0, 1, 2, 3], [1, 1, 1, 1], 0),
        ([126, 127, 0, 1], [1, 1, 1, 1], 0),  # wraps
        ([10, 11, 15], [1, 1, 4], 3),  # three lost
        ([126, 127, 4], [1, 1, 5], 4),  # lost across the wrap
        ([100, 101, 0, 1], [1, 1, 1, 1], 0),  # sender restarted: no time for 26
        ([7, 7, 7, 7], [1, 1, 1, 1], 0),  # counter stands still
        ([5, 4, 3], [1, 1, 1], 0),  # counts down
        ([1, 2, 3, 4], [1, 1, 6, 1], 0),  # congestion control: slow, nothing lost
    ],
)
def test_missed_messages_by_counter(counts: list[int], steps: list[int], sequence_gaps: int) -> None:
    world = World()
    t_s, total = 0.0, 0
    for k in range(40):
        receive(world, t_s, 10.0 * t_s, msg_cnt=(counts[0] - 40 + k) % 128)
        t_s += STEP_S
    for count, step in zip(counts, steps, strict=True):
        t_s += (step - 1) * STEP_S
        total += receive(world, t_s, 10.0 * t_s, msg_cnt=count)[2]
        t_s += STEP_S
    assert total == sequence_gaps


@pytest.mark.parametrize("lost", [50, 127, 128, 129, 600])
def test_messages_lost_in_a_long_gap_are_counted_beyond_the_modulus_of_the_counter(lost: int) -> None:
    world = World()
    for k in range(40):
        receive(world, k * STEP_S, 1.0 * k, msg_cnt=k)
    assert receive(world, (40 + lost) * STEP_S * 1.01, 0.0, msg_cnt=(40 + lost) % 128)[2] == lost


def test_a_counter_that_never_counts_tells_nothing_of_a_long_gap() -> None:
    world = World()
    for k in range(40):
        receive(world, k * STEP_S, 1.0 * k, msg_cnt=5)
    assert receive(world, 20.0, 0.0, msg_cnt=5)[2] == 0


def test_loss_does_not_lengthen_the_senders_own_interval() -> None:
    world = World()
    received = np.flatnonzero(np.random.default_rng(4).random(500) < 0.5)
    sequence_gaps = sum(receive(world, k * STEP_S, k * 1.0, msg_cnt=k % 128)[2] for k in received)
    assert world.tracks["interval_s"][0] == pytest.approx(0.1, rel=0.05)
    assert sequence_gaps == received[-1] - received[0] + 1 - len(received)


@pytest.mark.parametrize("interval_s", [0.02, 0.1, 0.6, 1.0])
def test_interval_follows_the_sender(interval_s: float) -> None:
    world = World()
    for k in range(100):
        receive(world, k * interval_s, 10.0 * k * interval_s, msg_cnt=k % 128)
    assert world.tracks["interval_s"][0] == pytest.approx(interval_s, rel=0.01)


def test_a_long_gap_sets_the_odometer_to_zero() -> None:
    world = World()
    receive(world, 0.0)
    for k in range(1, 50):
        assert not receive(world, k * STEP_S, k * 1.0)[3]
    generation = world.tracks["generation"][0]
    _, x_m, sequence_gaps, initialised = receive(world, 4.9 + 5.1, 100.0, msg_cnt=60)
    assert (x_m, sequence_gaps, initialised) == (0.0, 0, True)
    assert world.tracks["generation"][0] == generation + 1
    assert world.tracks["crumb_count"][0] == 1


def test_a_clock_that_jumps_ahead_and_back_costs_its_own_readings_only() -> None:
    world = World()
    for k in range(100):
        jump_s = 0.8 if k == 50 else 0.0
        outcome = receive(world, k * STEP_S + jump_s, k * 1.0)[0]
        rejected = Outcome.OUT_OF_ORDER if k < 58 else Outcome.CONTRADICTION
        assert outcome == (rejected if 50 < k <= 58 else Outcome.SCORED)
    assert world.tracks["x_m"][0] == pytest.approx(99.0, abs=1e-5)
    assert world.tracks["interval_s"][0] < 0.2


@pytest.mark.parametrize("speed", [5.0, 15.0, 30.0])
def test_the_path_reaches_back_150_m_in_bounded_memory(speed: float) -> None:
    record_seconds = 200.0 / speed + 5.0
    world = World()
    drive(world, [Car(STRAIGHT, lambda t: speed * t)], record_seconds)
    track = world.tracks[0]
    newest = track["newest_crumb"]
    oldest = (newest - track["crumb_count"] + 1) % CRUMBS
    assert track["crumbs"][newest, CRUMB_X] - track["crumbs"][oldest, CRUMB_X] >= 150.0
    x_m = np.roll(track["crumbs"][:, CRUMB_X], -int(oldest))[: track["crumb_count"]]
    assert np.diff(x_m).min() >= CRUMB_SPACING_M - 1e-4


def test_an_accepted_jump_clears_the_path_and_keeps_the_odometer() -> None:
    world = World()
    for k in range(100):
        receive(world, k * STEP_S, k * 1.0)
    generation = world.tracks["generation"][0]
    _, x_m, _, initialised = receive(world, 10.0, 300.0)
    assert (x_m, initialised) == (pytest.approx(300.0, abs=1e-3), False)
    assert world.tracks["crumb_count"][0] == 1
    assert world.tracks["generation"][0] == generation


def test_a_forgotten_row_is_free_and_its_next_vehicle_has_another_serial() -> None:
    world = World()
    receive(world, 0.0)
    before = int(world.tracks["generation"][0])
    evict(world.tracks, ROW)
    assert is_free(world.tracks[0])
    assert receive(world, 0.1, 500.0)[3]
    assert world.tracks["generation"][0] not in (0, before)
    assert world.tracks["x_m"][0] == 0.0


def test_length_and_accuracy_are_the_last_declared() -> None:
    world = World()
    receive(world, 0.0)
    assert world.tracks["length_m"][0] == DEFAULT_LENGTH_M
    assert math.isnan(world.tracks["accuracy_m"][0])
    lat, lon = lat_lon(0.0, 1.0)
    one = [np.array([value]) for value in (lat, lon, 10.0, 0.0)]
    world.advance(ROW, START_US + 100_000, *one, accuracy_m=1.5)
    assert world.tracks["accuracy_m"][0] == 1.5
    receive(world, 0.2, 2.0)
    assert world.tracks["accuracy_m"][0] == 1.5


def test_on_real_rows_the_odometer_agrees_with_the_wheels(shared_data: Path) -> None:
    """SPMD, 31 m/s: single-precision positions, so that a longitude is one of a grid of 0.6 m."""
    with (shared_data / "spmd_fixtures" / "sp2month_DataWsu.csv").open(encoding="utf-8-sig") as lines:
        rows = list(csv.DictReader(lines))
    world = World()
    x_m = []
    for row in rows:
        names = ("LatitudeWsu", "LongitudeWsu", "GpsSpeedWsu", "GpsHeadingWsu")
        one = (np.array([float(row[name])]) for name in names)
        x_m.append(world.advance(ROW, int(row["GpsTimeWsu"]) * 1000, *one)[1][0])
        world.extend_path_history(ROW, np.array([True]), np.zeros(1))
    t_s = np.array([int(row["GpsTimeWsu"]) for row in rows]) / 1000.0
    v_mps = np.array([float(row["SpeedWsu"]) for row in rows]) / 3.6
    wheels_m = np.append(0.0, np.cumsum(0.5 * (v_mps[1:] + v_mps[:-1]) * np.diff(t_s)))
    assert np.array(x_m) == pytest.approx(wheels_m, abs=0.63)


def set_off(world: World, speeds: list[float], course: float, *, noise_m: float = 0.0) -> np.ndarray:
    """The odometer (n,) of a vehicle that drives 20 m north, stands for 3 s, and then drives on `course` at `speeds`.

    It declares north all the time.
    """
    rng, direction = np.random.default_rng(4), (math.sin(math.radians(course)), math.cos(math.radians(course)))
    x_m, away_m = [], 0.0
    for k, speed in enumerate([5.0] * 40 + [0.0] * 30 + speeds):
        away_m += speed * STEP_S if k >= 70 else 0.0
        place = np.array([0.0, min(0.5 * (k + 1), 20.0)]) + away_m * np.array(direction) + rng.normal(0.0, noise_m, 2)
        x_m.append(receive(world, k * STEP_S, place[1], east_m=place[0], speed=speed)[1])
    return np.array(x_m)


SETS_OFF = [0.1 * k for k in range(30)] + [3.0] * 30


@pytest.mark.parametrize("noise_m", [0.0, 0.01])
def test_a_vehicle_that_drives_backwards_from_rest_covers_a_way(noise_m: float) -> None:
    """A speed has no sign, so neither has the way; only the first centimetres may go either way."""
    x_m = set_off(World(), SETS_OFF, 180.0, noise_m=noise_m)
    assert x_m[-1] - x_m[69] == pytest.approx(sum(SETS_OFF) * STEP_S, abs=0.3)
    assert np.diff(x_m[-30:]) == pytest.approx(0.3, abs=6.0 * noise_m + 1e-6)


def test_a_course_that_is_declared_as_the_heading_of_a_vehicle_that_backs_up_changes_nothing() -> None:
    held, turned = World(), World()
    for world in (held, turned):
        x_m = set_off(world, SETS_OFF, 180.0)
        for k in range(10):
            heading = 180.0 if world is turned else 0.0
            receive(
                world, (130 + k) * STEP_S, 20.0 - sum(SETS_OFF) * STEP_S - 0.3 * (k + 1), speed=3.0, heading=heading
            )
        assert world.tracks["x_m"][0] == pytest.approx(x_m[-1] + 3.0, abs=1e-3)


def test_a_vehicle_that_turns_as_it_sets_off_is_less_sure_of_its_odometer() -> None:
    """It declares the heading at which it came to rest until its receiver knows another."""
    world, speeds = World(), SETS_OFF[:20]
    x_m = set_off(world, speeds, 60.0)
    std_m = float(world.tracks["odometer_std_m"][0])
    assert std_m == pytest.approx(0.25 * sum(speeds) * STEP_S, rel=0.1)
    assert abs(x_m[-1] - x_m[69] - sum(speeds) * STEP_S) < 1.1 * std_m


def test_noise_at_rest_is_no_way() -> None:
    """Positions that wander by 30 cm, and speeds that are seldom 0, do not turn a vehicle round."""
    world, rng, x_m = World(), np.random.default_rng(8), []
    for k in range(600):
        speed = 5.0 if k < 40 else abs(rng.normal(0.0, 0.1))
        north_m = min(0.5 * (k + 1), 20.0) + rng.normal(0.0, 0.3)
        lat, lon = lat_lon(rng.normal(0.0, 0.3), north_m)
        one = (np.array([value]) for value in (lat, lon, speed, 0.0))
        x_m.append(float(world.advance(ROW, START_US + k * 100_000, *one)[1][0]))
        world.extend_path_history(
            ROW, np.array([True]), np.array([speed]), math.hypot(0.3, world.tracks["odometer_std_m"][0])
        )
    assert np.mean(x_m[-50:]) == pytest.approx(np.mean(x_m[60:110]), abs=0.5)
