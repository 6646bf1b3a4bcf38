import math

import numpy as np
import pytest
from core.roads import START_US, STEP_S, STRAIGHT, Car, Motion, Noise, Reading, Record, Road, Spoil, World, drive

from headway.core.tracking.pairing import NO_LEADER
from headway.core.tracking.tracks import DEFAULT_LENGTH_M, evict

BEND = Road(((150.0, 0.0), (60.0 * math.pi / 2, 1 / 60.0), (1e5, 0.0)))
RIGHT_TURN = Road(((60.0, 0.0), (8.0 * math.pi / 2, -1 / 8.0), (1e5, 0.0)))
LANE_M = 3.6


def at(start_m: float, speed: float) -> Motion:
    """Drive at one speed from there."""
    return lambda t: start_m + speed * t


def shift(begin_s: float, end_s: float, from_m: float, to_m: float) -> Motion:
    """Change lanes smoothly."""

    def left_m(t: float) -> float:
        part = min(max((t - begin_s) / (end_s - begin_s), 0.0), 1.0)
        return from_m + (to_m - from_m) * part * part * (3.0 - 2.0 * part)

    return left_m


def queue(start_m: float, stop_s: float, go_s: float, speed: float = 10.0) -> Motion:
    """Drive, stand, drive on; at once."""
    return lambda t: start_m + speed * (min(t, stop_s) + max(t - go_s, 0.0))


def takeovers(record: Record, row: int) -> list[int]:
    return [leader for _, leader in record.takeovers(row)]


def only_gap(record: Record, row: int) -> np.ndarray:
    gap = record.gap_m[:, row]
    return gap[~np.isnan(gap)]


def test_on_a_straight_road_the_next_ahead_is_the_leader_within_two_seconds() -> None:
    record = drive(World(), [Car(STRAIGHT, at(-25.0 * i, 15.0)) for i in range(4)], 10.0)
    assert record.leader[20:].tolist() == [[NO_LEADER, 0, 1, 2]] * 80
    assert only_gap(record, 1) == pytest.approx(25.0 - DEFAULT_LENGTH_M, abs=1e-3)


def test_in_a_bend_gap_is_arc_length_and_smooth() -> None:
    record = drive(World(), [Car(BEND, at(0.0, 12.0)), Car(BEND, at(30.0, 12.0))], 30.0)
    assert takeovers(record, 0) == [1]
    assert only_gap(record, 0) == pytest.approx(30.0 - DEFAULT_LENGTH_M, abs=0.01)
    assert np.abs(np.diff(only_gap(record, 0))).max() < 0.005


def test_in_a_bend_a_metre_to_the_side_costs_decimetres_and_comes_gently() -> None:
    """A follower a metre inside travels 1.6 m less in the quarter circle; the offset follows as it happens."""
    record = drive(World(), [Car(BEND, at(0.0, 12.0), at(1.0, 0.0)), Car(BEND, at(30.0, 12.0))], 30.0)
    assert takeovers(record, 0) == [1]
    assert only_gap(record, 0) == pytest.approx(30.0 - DEFAULT_LENGTH_M, abs=0.3)
    assert np.abs(np.diff(only_gap(record, 0))).max() < 0.15
    assert not record.changed[20:, 0].any()


def test_both_turn_at_a_crossing() -> None:
    record = drive(World(), [Car(RIGHT_TURN, at(0.0, 5.0)), Car(RIGHT_TURN, at(14.0, 5.0))], 30.0)
    assert takeovers(record, 0) == [1]
    assert only_gap(record, 0) == pytest.approx(14.0 - DEFAULT_LENGTH_M, abs=0.02)


@pytest.mark.parametrize(("follower", "leader"), [(RIGHT_TURN, STRAIGHT), (STRAIGHT, RIGHT_TURN)])
def test_a_leader_that_turns_off_is_lost_within_three_seconds_of_the_place(follower: Road, leader: Road) -> None:
    """The follower is at the turn, 60 m on, at 10 s."""
    record = drive(World(), [Car(follower, at(0.0, 6.0)), Car(leader, at(14.0, 6.0))], 20.0)
    assert takeovers(record, 0) == [1, NO_LEADER]
    assert record.takeovers(0)[-1][0] <= 13.5


def breathing(start_m: float, phase: float) -> Motion:
    """Drive at 12 m/s, now nearer to the one ahead and now farther."""
    return lambda t: start_m + 12.0 * t + 1.5 * math.sin(0.3 * t - phase)


def platoon(road: Road, seed: int, lanes: int = 1) -> tuple[list[Car], list[int]]:
    """Eight cars in random rows, each half a metre off in a direction of its own; and the order of their leaders."""
    rng = np.random.default_rng(seed)
    order = rng.permutation(8)
    cars: dict[int, Car] = {}
    leaders = [NO_LEADER] * 8
    for place, row in enumerate(order):
        lane = place % lanes
        off_rad = rng.uniform(0.0, 2.0 * math.pi)
        cars[row] = Car(
            road,
            breathing(100.0 - 24.0 * (place // lanes) - 9.0 * lane, place),
            at(LANE_M * lane, 0.0),
            offset_m=(0.5 * math.cos(off_rad), 0.5 * math.sin(off_rad)),
        )
        if place >= lanes:
            leaders[row] = int(order[place - lanes])
    return [cars[row] for row in range(8)], leaders


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("road", [STRAIGHT, BEND])
def test_the_order_of_a_platoon_is_found_from_positions_alone(road: Road, seed: int) -> None:
    cars, leaders = platoon(road, seed)
    record = drive(World(), cars, 25.0, noise=Noise(seed), shuffle_seed=seed)
    assert record.leader[50:].tolist() == [leaders] * 200


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("road", [STRAIGHT, BEND])
def test_two_lanes_side_by_side_do_not_mix(road: Road, seed: int) -> None:
    cars, leaders = platoon(road, seed, lanes=2)
    record = drive(World(), cars, 25.0, noise=Noise(seed), shuffle_seed=seed)
    assert record.leader[80:].tolist() == [leaders] * 170


def test_oncoming_and_crossing_vehicles_lead_no_one() -> None:
    oncoming = Road(((1e5, 0.0),), math.pi, -LANE_M, 400.0)
    crossing = Road(((1e5, 0.0),), math.pi / 2, -200.0, 220.0)
    cars = [Car(STRAIGHT, at(0.0, 12.0)), Car(oncoming, at(0.0, 12.0)), Car(crossing, at(0.0, 12.0))]
    record = drive(World(), cars, 30.0)
    assert (record.leader == NO_LEADER).all()


def test_a_car_that_just_crossed_where_the_follower_waits_is_not_its_leader() -> None:
    crossing = Road(((1e5, 0.0),), math.pi / 2, -96.0, 101.0)
    cars = [Car(STRAIGHT, queue(0.0, 10.0, 20.0)), Car(crossing, at(0.0, 12.0))]
    record = drive(World(), cars, 25.0)
    assert (record.leader == NO_LEADER).all()


@pytest.mark.parametrize("angle_deg", [30.0, 60.0, 90.0])
def test_a_vehicle_first_received_standing_at_an_angle_is_not_in_the_lane(angle_deg: float) -> None:
    """Straight behind it is the follower, but neither's heading leads along that line."""
    angle = math.radians(angle_deg)
    aside = Road(((1e5, 0.0),), angle, 20.0 * math.sin(angle), 20.0 * math.cos(angle) + 0.5)
    record = drive(World(), [Car(STRAIGHT, at(0.0, 0.0)), Car(aside, at(0.0, 0.0))], 5.0)
    assert (record.leader == NO_LEADER).all()


def test_follower_changes_lane() -> None:
    cars = [
        Car(STRAIGHT, at(0.0, 20.0), shift(10.0, 13.0, 0.0, LANE_M)),
        Car(STRAIGHT, at(30.0, 20.0)),
        Car(STRAIGHT, at(45.0, 20.0), at(LANE_M, 0.0)),
    ]
    record = drive(World(), cars, 20.0)
    assert takeovers(record, 0) == [1, 2]
    assert 11.5 <= record.takeovers(0)[-1][0] <= 14.0


@pytest.mark.parametrize("road", [STRAIGHT, BEND])
def test_a_car_that_cuts_in_leads_before_the_follower_is_where_it_did(road: Road) -> None:
    """It is over the line at 9.5 s and 25 m ahead: its path is beside the follower two seconds later."""
    cars = [
        Car(road, at(0.0, 12.0)),
        Car(road, at(50.0, 12.0)),
        Car(road, at(25.0, 12.0), shift(8.0, 11.0, LANE_M, 0.0)),
    ]
    record = drive(World(), cars, 20.0)
    assert takeovers(record, 0) == [1, 2]
    assert 9.5 <= record.takeovers(0)[-1][0] <= 11.5
    assert takeovers(record, 2) == [1]
    assert only_gap(record, 0)[-1] == pytest.approx(25.0 - DEFAULT_LENGTH_M, abs=0.5)


def test_a_leader_that_leaves_the_lane_is_replaced_by_the_one_it_followed() -> None:
    cars = [
        Car(STRAIGHT, at(0.0, 12.0)),
        Car(STRAIGHT, at(50.0, 12.0)),
        Car(STRAIGHT, at(25.0, 12.0), shift(8.0, 11.0, 0.0, LANE_M)),
    ]
    record = drive(World(), cars, 20.0)
    assert takeovers(record, 0) == [2, 1]
    assert 9.5 <= record.takeovers(0)[-1][0] <= 12.0


def wander(row: int, begin_s: float, end_s: float, east_m: float, north_m: float = 0.0) -> Spoil:
    """Put one receiver off for a while."""

    def spoil(who: int, t_s: float, r: Reading) -> Reading:
        if who != row or not begin_s < t_s < end_s:
            return r
        return r[0] + north_m / 111_200.0, r[1] + east_m / 74_300.0, r[2], r[3]

    return spoil


@pytest.mark.parametrize("row", [0, 1])
@pytest.mark.parametrize(("east_m", "seconds"), [(-4.0, 0.9), (4.0, 0.9), (2.2, 5.0)])
def test_a_receiver_that_wanders_sideways_does_not_change_the_leader(row: int, east_m: float, seconds: float) -> None:
    cars = [
        Car(STRAIGHT, at(0.0, 20.0)),
        Car(STRAIGHT, at(30.0, 20.0)),
        Car(STRAIGHT, at(60.0, 20.0)),
        Car(STRAIGHT, at(15.0, 20.0), at(LANE_M, 0.0)),
    ]
    record = drive(World(), cars, 25.0, noise=wander(row, 10.0, 10.0 + seconds, east_m))
    assert takeovers(record, 0) == [1]


@pytest.mark.parametrize("row", [0, 1])
def test_a_rejected_error_along_the_road_moves_nothing(row: int) -> None:
    def location_valid(who: int, t_s: float) -> bool:
        return who != row or not 10.0 < t_s < 20.0

    cars = [Car(STRAIGHT, at(0.0, 12.0)), Car(STRAIGHT, at(30.0, 12.0))]
    world = World()
    record = drive(world, cars, 25.0, noise=wander(row, 10.0, 20.0, 0.0, 20.0), location_valid=location_valid)
    assert takeovers(record, 0) == [1]
    assert record.changed.sum() == 1
    assert world.pairing["offset_m"][0] == pytest.approx(30.0, abs=1e-3)
    faulty_steps = np.array([10.0 < t_s < 20.0 for t_s in record.t_s])
    assert record.gap_m[faulty_steps, 0] == pytest.approx(30.0 - DEFAULT_LENGTH_M + (20.0 if row else -20.0), abs=0.01)
    assert record.gap_m[~faulty_steps][20:, 0] == pytest.approx(30.0 - DEFAULT_LENGTH_M, abs=0.01)


@pytest.mark.parametrize("row", [0, 1])
def test_an_accepted_error_along_the_road_cancels(row: int) -> None:
    """The odometer and the place on the path move by the same error."""
    cars = [Car(STRAIGHT, at(0.0, 12.0)), Car(STRAIGHT, at(30.0, 12.0))]
    world = World()
    record = drive(world, cars, 25.0, noise=wander(row, 10.0, 20.0, 0.0, 8.0))
    assert takeovers(record, 0) == [1]
    assert world.pairing["offset_m"][0] == pytest.approx(30.0, abs=0.01)


def test_a_queue_that_stands_keeps_its_order() -> None:
    cars = [Car(STRAIGHT, queue(-7.0 * i, 10.0, 40.0)) for i in range(5)]
    record = drive(World(), cars, 60.0, noise=Noise(1))
    assert record.leader[20:].tolist() == [[NO_LEADER, 0, 1, 2, 3]] * 580


def test_a_queue_first_received_standing_is_ordered_by_its_headings() -> None:
    cars = [Car(STRAIGHT, queue(-7.0 * i, 10.0, 40.0)) for i in range(5)]
    record = drive(World(), cars, 10.0, start_s=15.0)
    assert record.leader[20:].tolist() == [[NO_LEADER, 0, 1, 2, 3]] * 80


def test_without_headings_the_order_is_found_once_they_move() -> None:
    cars = [Car(STRAIGHT, at(-25.0 * i, 15.0), declares_heading=False) for i in range(4)]
    record = drive(World(), cars, 10.0)
    assert record.leader[25:].tolist() == [[NO_LEADER, 0, 1, 2]] * 75


def test_a_silent_leader_is_lost_and_found_again() -> None:
    cars = [Car(STRAIGHT, at(0.0, 2.0)), Car(STRAIGHT, at(30.0, 2.0))]
    record = drive(World(), cars, 25.0, silent=lambda row, t_s: row == 1 and 8.0 < t_s < 16.0)
    assert takeovers(record, 0) == [1, NO_LEADER, 1]
    lost_s, found_s = (t_s for t_s, _ in record.takeovers(0)[1:])
    assert 8.0 + 2.0 < lost_s < 8.0 + 5.0
    assert 16.0 < found_s < 18.0


def test_the_next_vehicle_in_a_leaders_row_is_not_taken_for_it() -> None:
    world = World()
    drive(world, [Car(STRAIGHT, at(0.0, 15.0)), Car(STRAIGHT, at(30.0, 15.0))], 5.0)
    assert world.leaders()[0] == 1
    evict(world.tracks, np.array([1]))
    assert world.leaders()[0] == NO_LEADER
    record = drive(world, [Car(STRAIGHT, at(0.0, 15.0)), Car(STRAIGHT, at(-400.0, 15.0))], 5.0, start_s=5.0)
    assert (record.leader[:, 0] == NO_LEADER).all()
    assert record.changed[:, 0].sum() == 1


def test_the_next_vehicle_in_a_followers_row_inherits_no_leader() -> None:
    world = World()
    drive(world, [Car(STRAIGHT, at(0.0, 15.0)), Car(STRAIGHT, at(30.0, 15.0))], 5.0)
    evict(world.tracks, np.array([0]))
    elsewhere = Car(Road(((1e5, 0.0),), math.pi / 2, 0.0, 90.0), at(0.0, 15.0))
    one = (np.array([value]) for value in elsewhere.reading(5.0))
    world.advance(np.array([0]), START_US + 4_950_000, *one)
    assert world.leaders()[0] == NO_LEADER
    record = drive(world, [elsewhere, Car(STRAIGHT, at(30.0, 15.0))], 5.0, start_s=5.0)
    assert (record.leader[:, 0] == NO_LEADER).all()


def test_a_declared_leader_is_accepted_at_the_next_search() -> None:
    """Two ahead in the lane; the follower names the farther one, which its radar may well see."""
    cars = [Car(STRAIGHT, at(0.0, 15.0)), Car(STRAIGHT, at(20.0, 15.0)), Car(STRAIGHT, at(60.0, 15.0))]
    world = World()
    record = drive(world, cars, 5.0, declared={0: 2})
    assert takeovers(record, 0) == [2]
    assert record.takeovers(0)[0][0] <= 0.6
    assert only_gap(record, 0) == pytest.approx(60.0 - DEFAULT_LENGTH_M, abs=0.01)


@pytest.mark.parametrize("named", [0, 2, 3, 4, 5])
def test_an_impossible_declared_leader_is_not_accepted(named: int) -> None:
    """Oneself, the car behind, one out of range, one on a road beside, a row that is free."""
    cars = [
        Car(STRAIGHT, at(0.0, 15.0)),
        Car(STRAIGHT, at(20.0, 15.0)),
        Car(STRAIGHT, at(-20.0, 15.0)),
        Car(STRAIGHT, at(400.0, 15.0)),
        Car(STRAIGHT, at(20.0, 15.0), at(40.0, 0.0)),
    ]
    record = drive(World(), cars, 5.0, declared={0: named})
    assert takeovers(record, 0) == [1]


def test_a_place_on_the_path_that_jumps_by_a_lap_is_a_change() -> None:
    """Twice round: the leader takes the second lap in the outer lane, and the lap before is beside the follower."""
    ring = Road(((1e6, 1 / 15.0),))
    lap_m = 30.0 * math.pi
    cars = [Car(ring, at(0.0, 8.0)), Car(ring, at(0.25 * lap_m, 8.0), shift(11.0, 13.0, 0.0, -LANE_M))]
    world = World()
    offset_m, changed, leader = [], [], []
    for k in range(250):
        record = drive(world, cars, STEP_S, start_s=k * STEP_S)
        offset_m.append(float(world.pairing["offset_m"][0]))
        changed.append(bool(record.changed[0, 0]))
        leader.append(int(record.leader[0, 0]))
    assert set(leader) == {NO_LEADER, 1}
    leaps = np.flatnonzero(np.abs(np.diff(offset_m)) > 0.2) + 1
    assert leaps.size == 2
    assert np.flatnonzero(changed).tolist() == leaps.tolist()
    assert offset_m[-1] == pytest.approx(1.25 * lap_m, abs=0.5)


def test_two_vehicles_that_declare_each_other_are_two_pairs() -> None:
    ring = Road(((1e6, 1 / 15.0),))
    half_m = 15.0 * math.pi
    record = drive(World(), [Car(ring, at(0.0, 8.0)), Car(ring, at(half_m, 8.0))], 30.0, declared={0: 1, 1: 0})
    assert record.leader[-1].tolist() == [1, 0]
    assert record.gap_m[-1] == pytest.approx(half_m - DEFAULT_LENGTH_M, abs=0.2)


def test_each_vehicle_searches_twice_a_second_and_not_all_at_once() -> None:
    world = World(capacity=200)
    rows = np.arange(200)
    lat = 48.0 + rows * 1e-3
    searches = np.zeros((40, 200), np.bool_)
    for k in range(40):
        t_us = START_US + round(k * STEP_S * 1e6)
        world.advance(rows, t_us, lat, np.full(200, 11.0), np.zeros(200), np.zeros(200))
        world.find_leaders(rows, t_us)
        searches[k] = world.pairing["search_us"] == t_us
    assert searches.sum(axis=0).min() >= 6
    assert searches.sum(axis=0).max() <= 9
    assert searches.sum(axis=1).max() < 120


def test_another_row_for_each_vehicle_changes_nothing() -> None:
    """A platoon, a cut-in and noise, on the first rows of a table and scattered over another."""
    cars = [Car(BEND, at(-25.0 * n, 12.0 - 0.1 * n), shift(8.0, 10.0, LANE_M * (n == 2), 0.0)) for n in range(5)]
    scattered = [11, 3, 14, 7, 2]
    plain, moved = World(), World()
    noise = Noise(5)
    for k in range(300):
        t_us = START_US + round(k * STEP_S * 1e6)
        readings = [noise(n, k * STEP_S, car.reading(k * STEP_S)) for n, car in enumerate(cars)]
        columns = [np.array(column) for column in zip(*readings, strict=True)]
        for world, rows in ((plain, np.arange(5)), (moved, np.array(scattered))):
            world.advance(rows, t_us, *columns, msg_cnt=k)
            world.extend_path_history(rows, np.ones(5, np.bool_), columns[2])
            world.find_leaders(rows, t_us)
        leaders = [moved.leaders()[row] for row in scattered]
        assert [scattered.index(row) if row != NO_LEADER else NO_LEADER for row in leaders] == plain.leaders()[:5]
        for name in ("search_us", "offset_m", "confirmations", "coasts"):
            assert moved.pairing[name][scattered].tolist() == plain.pairing[name][:5].tolist()
    assert plain.leaders()[:5] == [NO_LEADER, 0, 1, 2, 3]


@pytest.mark.parametrize(("accuracy_m", "leader"), [(math.nan, NO_LEADER), (0.1, NO_LEADER), (1.0, 1), (10.0, 1)])
def test_the_corridor_is_wider_for_a_declared_accuracy_but_never_by_a_lane(accuracy_m: float, leader: int) -> None:
    """The car ahead is 2.3 m to the left, half a lane is 1.8 m; another drives in the next lane, nearer."""
    world = World(capacity=3)
    cars = [
        Car(STRAIGHT, at(0.0, 15.0)),
        Car(STRAIGHT, at(40.0, 15.0), at(2.3, 0.0)),
        Car(STRAIGHT, at(20.0, 15.0), at(-LANE_M, 0.0)),
    ]
    rows = np.arange(3)
    for k in range(30):
        t_us = START_US + round(k * STEP_S * 1e6)
        columns = (np.array(column) for column in zip(*(car.reading(k * STEP_S) for car in cars), strict=True))
        world.advance(rows, t_us, *columns, accuracy_m=accuracy_m)
        world.extend_path_history(rows, np.ones(3, np.bool_), np.full(3, 15.0))
        world.find_leaders(rows, t_us)
    assert world.leaders()[0] == leader
