"""A mode that the readings exclude for long does not run away with the estimate."""

import random

import numpy as np
import pytest
from made_recording import BEGIN, northbound

from headway import Detector


@pytest.mark.parametrize(("scatter_m", "scatter_mps"), [(3.0, 2.0), (10.0, 5.0)])
@pytest.mark.parametrize("seed", [1, 2])
def test_an_estimate_is_where_a_car_can_be_while_both_sensors_scatter(
    scatter_m: float, scatter_mps: float, seed: int
) -> None:
    """For a minute there is no usable reading: what remains is dead reckoning, whose speed errs by some m/s."""
    records, north_m = northbound(
        lambda _s, rng: (rng.gauss(0.0, scatter_m), rng.gauss(0.0, scatter_mps)), random.Random(seed)
    )
    verdicts = Detector().process(records).verdicts
    blue = np.arange(1, len(records), 2)
    before = blue[BEGIN - 100 : BEGIN]
    off_m = np.median((verdicts["x_m"] - north_m)[before])
    assert np.nanmax(np.abs((verdicts["x_m"] - north_m)[blue] - off_m)) < 1_000.0
    assert np.nanmax(np.abs(verdicts["v_mps"][blue])) < 50.0


def drift_then_scatter(s: float, rng: random.Random) -> tuple[float, float]:
    """Let the speed drift away by 10 m/s, then the position scatter by 5 m, then one speed be off; every 5 s."""
    part = s % 5.0
    off_m = rng.gauss(0.0, 5.0) if 2.0 <= part < 3.0 else 0.0
    off_mps = -10.0 * part if part < 1.0 else rng.gauss(0.0, 5.0) if 3.0 <= part < 3.1 else 0.0
    return off_m, off_mps


@pytest.mark.parametrize("seed", [1, 3, 5])
def test_an_estimate_has_the_speed_of_a_car_while_one_fault_follows_another(seed: int) -> None:
    """Modes that the readings excluded for long are the estimate once a reading excludes the others."""
    records, _ = northbound(drift_then_scatter, random.Random(seed))
    speeds_mps = Detector().process(records).verdicts["v_mps"][1::2]
    assert np.nanmin(speeds_mps) > -5.0
    assert np.nanmax(speeds_mps) < 40.0
