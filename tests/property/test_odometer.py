"""Whatever is sent, tracks and pairing stay finite, bounded and independent of the order within a round."""

import math

import numpy as np
from core.roads import columns_of
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from headway.core.tracking.geodesy import metres_per_degree
from headway.core.tracking.odometer import CRUMB_SPACING_M
from headway.core.tracking.pairing import NO_LEADER, find_leaders, gaps_m, leader_of, new_pairing
from headway.core.tracking.spatial_index import new_grid
from headway.core.tracking.tracks import CRUMB_X, CRUMBS, advance, extend_path_history, new_tracks
from headway.core.types.outcome import Outcome
from headway.core.types.records import Records

ROWS = 4
START_US = 1_700_000_000_000_000
MAX_GAP_S = 5.0

readings = st.tuples(
    st.sampled_from([48.0, 48.0001, 48.0005, 90.0, -90.0, 0.0]) | st.floats(-90.0, 90.0),
    st.sampled_from([11.0, 11.0001, 180.0, -180.0]) | st.floats(-180.0, 180.0),
    st.sampled_from([0.0, 0.4, 15.0]) | st.floats(0.0, 163.8),
    st.just(math.nan) | st.floats(0.0, 360.0),
    st.booleans(),
)
rounds = st.lists(
    st.tuples(st.integers(-1_000_000, 7_000_000), st.lists(readings, min_size=ROWS, max_size=ROWS)),
    min_size=1,
    max_size=25,
)


def run(drive: list, order: NDArray[np.int64]) -> tuple[Records, Records]:
    """Process the rounds, with the rows of each round in this order."""
    tracks, pairing, grid = new_tracks(ROWS), new_pairing(ROWS), new_grid(ROWS)
    t_us = START_US
    for step_us, columns in drive:
        t_us += step_us
        lat, lon, speed, heading, location_valid = (np.array(column)[order] for column in zip(*columns, strict=True))
        times = np.full(ROWS, t_us)
        unknown, changed = np.full(ROWS, np.nan), np.empty(ROWS, np.bool_)
        numbers = columns_of(times, times // 100_000 % 128, lat, lon, speed, heading, unknown)
        done = advance(tracks, order, numbers, np.arange(ROWS), MAX_GAP_S)
        ok = done.outcome == Outcome.SCORED
        assert (done.sequence_gap >= 0).all()
        assert (done.sequence_gap[~done.initialised] < 128).all()
        extend_path_history(tracks, order[ok], location_valid[ok], speed[ok], np.full(len(order[ok]), 1e-4))
        find_leaders(tracks, pairing, grid, order[ok], (order[ok] + 1) % ROWS, t_us, 150.0, 3.6, changed)
    return tracks, pairing


@settings(deadline=None, max_examples=150)
@given(rounds)
def test_any_readings_leave_finite_bounded_tracks(drive: list) -> None:
    tracks, pairing = run(drive, np.arange(ROWS))
    for name in tracks.dtype.names:
        if tracks.dtype[name].kind == "f" and name != "accuracy_m":
            assert np.isfinite(tracks[name]).all(), name
    assert ((tracks["crumb_count"] >= 1) & (tracks["crumb_count"] <= CRUMBS)).all()
    assert ((tracks["interval_s"] >= 0.01) & (tracks["interval_s"] <= MAX_GAP_S)).all()
    size = np.hypot(tracks["heading_east"], tracks["heading_north"])
    assert (np.isclose(size, 1.0) | (size == 0.0)).all()
    for track in tracks:
        back = (track["newest_crumb"] - np.arange(track["crumb_count"])) % CRUMBS
        assert (np.diff(track["crumbs"][back, CRUMB_X]) <= -CRUMB_SPACING_M + 1e-3).all()
    for row in range(ROWS):
        leader, gap_m = leader_of(tracks, pairing, row), np.empty(1)
        gaps_m(tracks, pairing, np.array([row]), gap_m)
        assert leader != row
        assert NO_LEADER <= leader < ROWS
        assert np.isfinite(gap_m[0]) == (leader != NO_LEADER)


@settings(deadline=None, max_examples=50)
@given(rounds, st.permutations(range(ROWS)))
def test_the_order_of_rows_within_a_round_has_no_effect(drive: list, order: list[int]) -> None:
    for one, other in zip(run(drive, np.arange(ROWS)), run(drive, np.array(order)), strict=True):
        assert one.tobytes() == other.tobytes()


@settings(deadline=None, max_examples=50)
@given(
    st.dictionaries(st.integers(1, 58), st.tuples(st.floats(-500.0, 500.0), st.floats(-500.0, 500.0)), max_size=20),
    st.floats(0.0, 360.0),
)
def test_rejected_positions_have_no_effect(faults: dict[int, tuple[float, float]], heading: float) -> None:
    """A straight drive at 20 m/s in any direction: its last odometer is its length, whatever was sent on the way."""
    tracks, row = new_tracks(1), np.array([0])
    direction = math.sin(math.radians(heading)), math.cos(math.radians(heading))
    east_per_degree, north_per_degree = metres_per_degree(48.0)
    for k in range(60):
        off = faults.get(k, (0.0, 0.0))
        east, north = (2.0 * k * d + o for d, o in zip(direction, off, strict=True))
        place = 48.0 + north / north_per_degree, 11.0 + east / east_per_degree
        one = (np.array([value]) for value in (*place, 20.0, heading, np.nan))
        advance(tracks, row, columns_of(np.array([START_US + k * 100_000]), np.array([k]), *one), row, MAX_GAP_S)
        extend_path_history(tracks, row, np.array([k not in faults]), np.array([20.0]), np.array([1e-4]))
    assert abs(tracks["x_m"][0] - 118.0) < 0.01
