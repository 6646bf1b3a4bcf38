"""Positions that a receiver repeats, or sends one message late, are no faults of it."""

import numpy as np
import pytest
from core.driving import drive, run_model

from headway.core.types.records import Sensor

REPEATED = range(300, 900, 12)


def repeating(rng, late=slice(0, 0)):
    """A drive whose positions are repeated now and then, and in `late` each come one message late."""
    read, x, _ = drive(rng)
    for name in ("east_m", "north_m"):
        read[name] = 1.0
    shown = x.copy()
    for k in REPEATED:
        shown[k], read["east_m"][k], read["north_m"][k] = shown[k - 1], 0.0, 0.0
    shown[late] = x[late.start - 1 : late.stop - 1]
    read["x_m"] = shown + np.where(read["east_m"] == 0.0, 0.0, rng.normal(0.0, 0.01, x.size))
    return read


@pytest.mark.parametrize("seed", range(4))
def test_positions_that_come_one_message_late_are_no_alarm(seed: int) -> None:
    results, _ = run_model(repeating(np.random.default_rng(seed), slice(720, 740)))
    assert not results["anomalous"][300:].any()


def test_positions_that_stay_late_are_an_offset() -> None:
    results, _ = run_model(repeating(np.random.default_rng(0), slice(720, 790)))
    assert not results["anomalous"][300:745].any()
    alarms = 745 + np.flatnonzero(results["anomalous"][745:790])
    assert alarms.size
    assert (results["sensor"][alarms] == Sensor.LOCATION).all()


def test_a_receiver_that_repeats_nothing_is_never_late() -> None:
    read, x, _ = drive(np.random.default_rng(0))
    read["east_m"] = 1.0
    read["x_m"][720:740] = x[719:739]
    results, _ = run_model(read)
    assert results["anomalous"][720:740].any()


@pytest.mark.parametrize("offset_m", [-4.0, 1.0, 4.0])
def test_other_offsets_of_such_a_receiver_are_found(offset_m: float) -> None:
    read = repeating(np.random.default_rng(1))
    read["x_m"][720:740] += offset_m
    results, _ = run_model(read)
    assert results["anomalous"][720:740].any()
