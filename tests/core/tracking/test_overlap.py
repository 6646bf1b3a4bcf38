import numpy as np
import pytest

from headway.core.tracking.overlap import is_named, observe_overlap
from headway.core.tracking.tracks import new_tracks

METRE_DEG = 1.0 / 111_083.0  # of latitude at 42 degrees north
METRE_DEG_EAST = 1.0 / 82_847.0  # of longitude there
SEARCH_US = 500_000


def vehicles(counts, ahead_m=0.0, aside_m=0.0, accuracy_m=0.3, v_mps=15.0):
    """Two vehicles that drive north; the second is `ahead_m` ahead of and `aside_m` beside the first."""
    made = new_tracks(2)
    made["count"], made["generation"], made["t_us"] = counts, 1, 1_000_000
    made["lat_deg"], made["lon_deg"] = [42.0, 42.0 + ahead_m * METRE_DEG], [-83.0, -83.0 + aside_m * METRE_DEG_EAST]
    made["heading_north"], made["v_mps"], made["length_m"], made["accuracy_m"] = 1.0, v_mps, 4.7, accuracy_m
    return made


def named(tracks, searches, searching=0):
    """Whether each is named after so many searches of one of them."""
    other = np.array([1 - searching])
    for _ in range(searches):
        observe_overlap(tracks, searching, other, np.array([4.0]), 1)
        tracks["t_us"] += SEARCH_US
        tracks["count"] += 5
    return [is_named(track) for track in tracks]


@pytest.mark.parametrize("searching", [0, 1])
@pytest.mark.parametrize(("ahead_m", "aside_m"), [(0.0, 0.0), (1.0, 0.3), (-1.0, -0.3)])
def test_a_vehicle_that_comes_into_the_place_of_another_is_named(searching, ahead_m, aside_m):
    tracks = vehicles([200, 3], ahead_m, aside_m)
    assert named(tracks, 3, searching) == [False, False]
    assert named(tracks, 2, searching) == [False, True]


@pytest.mark.parametrize("counts", [[200, 300], [3, 5]])
def test_of_two_old_ones_or_two_new_ones_neither_is_named(counts):
    assert named(vehicles(counts), 10) == [False, False]


@pytest.mark.parametrize(
    "place",
    [
        {"aside_m": 1.0},
        {"ahead_m": 2.3},
        {"aside_m": 0.5, "accuracy_m": 0.5},
        {"accuracy_m": 1.0},
        {"accuracy_m": np.nan},
        {"v_mps": 1.0},
    ],
)
def test_bodies_overlap_only_beyond_both_accuracies_and_in_motion(place):
    assert named(vehicles([200, 3], **place), 10) == [False, False]


def test_it_is_over_when_the_two_part():
    tracks = vehicles([200, 3])
    assert named(tracks, 5) == [False, True]
    tracks["lat_deg"][1] += 20.0 * METRE_DEG
    assert named(tracks, 3) == [False, False]
