"""Statistics of the error processes, from their definitions."""

import numpy as np
import pytest
from loadtest.evaluate.field.made import driving

from headway_loadtest.evaluate.field.gnss import (
    POSITION_TAU_S,
    SPEED_TAU_S,
    WHITE_SHARE,
    GnssError,
    add_gnss_error,
    ornstein_uhlenbeck,
)
from headway_loadtest.evaluate.field.recordings import local_m


@pytest.mark.parametrize("tau_s", [0.2, 3.0])
def test_the_process_has_its_variance_and_correlation(tau_s):
    rng = np.random.default_rng(1)
    t_s = np.cumsum(rng.choice((0.1, 0.2), 200_000))
    made = ornstein_uhlenbeck(rng, t_s, 2.0, tau_s)
    assert made.std() == pytest.approx(2.0, rel=0.05)
    for step_s in (0.1, 0.2):
        at = np.flatnonzero(np.isclose(np.diff(t_s), step_s))
        assert np.corrcoef(made[at], made[at + 1])[0, 1] == pytest.approx(np.exp(-step_s / tau_s), abs=0.01)


def test_a_receiver_has_the_error_that_its_name_gives():
    clean, track = (driving(seconds=20_000.0).messages for _ in range(2))
    add_gnss_error(np.random.default_rng(2), track, GnssError(0.5, 0.2))
    (north, east), (true_north, true_east) = (local_m(one, 45.0, 9.0) for one in (track, clean))
    off = np.stack([north - true_north, east - true_east])
    assert off.std(axis=1) == pytest.approx(0.5, rel=0.15)
    expected = np.sqrt(2.0) * np.hypot(0.5 * np.sqrt(1.0 - np.exp(-0.1 / POSITION_TAU_S)), WHITE_SHARE * 0.5)
    assert np.diff(off, axis=1).std(axis=1) == pytest.approx(expected, rel=0.02)
    mps = track["speed_mps"] - clean["speed_mps"]
    assert mps.std() == pytest.approx(0.2, rel=0.03)
    assert np.corrcoef(mps[:-1], mps[1:])[0, 1] == pytest.approx(np.exp(-0.1 / SPEED_TAU_S), abs=0.02)
    heading = (track["heading_deg"] + 180.0) % 360.0 - 180.0
    assert heading.std() == pytest.approx(np.degrees(0.2 / 10.0), rel=0.05)
    assert (track["accuracy_m"] == 0.5).all()
