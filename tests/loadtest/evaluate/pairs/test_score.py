"""What verdicts are worth, on drives small enough to count by hand."""

import numpy as np
import pytest

from headway.core.runtime.rows import verdicts
from headway.core.types import records
from headway_loadtest.evaluate.pairs.drive import InjectedDrive, Pair
from headway_loadtest.evaluate.pairs.score import auc, episodes, gate_for, score, summary, total
from headway_loadtest.inject.faults import Corrupted, Injected, Kind, Sensor

N = 100


def drive(events, alarms, sensor=records.Sensor.LOCATION, kind=records.Kind.BIAS, offset=2.0, left=0.5):
    """A car at rest; faults of `offset`, of which `left` remains in the estimate; alarms at the given samples."""
    zero = np.zeros(N)
    x, v = zero.copy(), zero.copy()
    x_kind, v_kind = np.zeros(N, np.uint8), np.zeros(N, np.uint8)
    for event in events:
        place = slice(event.start, event.stop)
        readings, codes = (x, x_kind) if event.sensor is Sensor.LOCATION else (v, v_kind)
        readings[place] += offset
        codes[place] = event.kind
    results = verdicts(N)
    results["statistic"][alarms], results["anomalous"][alarms] = 5.0, True
    results["sensor"][alarms], results["kind"][alarms] = sensor, kind
    results["x_m"][x_kind > 0], results["v_mps"][v_kind > 0] = left, left
    results["warming"][:10] = True
    pair = Pair("set", 0.1 * np.arange(N), zero, zero, 5.0, zero, zero)
    injected = InjectedDrive(1.0, "all", Corrupted(x, v, np.ones(N, np.bool_), x_kind, v_kind, tuple(events)))
    return score(pair, injected, results)


BIAS = Injected(Sensor.LOCATION, Kind.BIAS, 30, 40)
SPIKE = Injected(Sensor.SPEED, Kind.NOISE, 60, 61)


def test_an_event_is_found_until_a_second_after_its_last_sample() -> None:
    assert drive([BIAS], [30]).found["bias"] == 1
    assert drive([BIAS], [49]).found["bias"] == 1
    assert drive([BIAS], [50]).found["bias"] == 0
    assert drive([BIAS], [29]).found["bias"] == 0


def test_an_alarm_outside_all_windows_is_false_and_counted_once() -> None:
    assert drive([BIAS], [20, 22, 70, 71, 79]).false_alarms == 2
    assert drive([BIAS], [28, 29, 30, 31]).false_alarms == 0
    assert drive([], [20, 70]).false_alarms == 2


def test_warming_readings_do_not_count() -> None:
    early = Injected(Sensor.LOCATION, Kind.BIAS, 5, 9)
    made = drive([early], [6])
    assert made.events.total() == 0
    assert made.false_alarms == 0
    assert list(made.samples) == [0, 0]


def test_the_last_word_on_the_right_sensor_is_what_counts() -> None:
    right = drive([BIAS], [31, 39])
    assert right.kinds["bias", "bias"] == 1
    assert right.named == 1
    assert drive([BIAS], [31], sensor=records.Sensor.SPEED).named == 0
    assert drive([SPIKE], [60], sensor=records.Sensor.BOTH, kind=records.Kind.SHORT).kinds["short", "short"] == 1


def test_errors_are_compared_over_the_samples_that_lie() -> None:
    row = summary([drive([BIAS, SPIKE], [30, 60])])
    assert row["corrupted_rmse_m"] == pytest.approx(2.0)
    assert row["recovered_rmse_mps"] == pytest.approx(0.5)
    assert row["recovered_share_location"] == pytest.approx(0.25)


def test_the_ceiling_knows_the_truth() -> None:
    made = drive([BIAS], [30, 31, 32, 33, 34])
    assert made.ceiling == [1.0]
    assert made.auc == [pytest.approx(0.75)]
    assert summary([made])["share_of_ceiling"] == pytest.approx(0.5)


def test_nothing_measured_is_none_and_not_zero() -> None:
    row = summary([drive([], [])])
    for name in ("auc", "ceiling", "share_of_ceiling", "recall_at_budget", "kind_correct", "recovered_rmse_m"):
        assert row[name] is None
    assert row["events"] == 0


def test_totals_add_up() -> None:
    both = total([drive([BIAS], [31]), drive([BIAS, SPIKE], [80])])
    assert (both.found.total(), both.events.total(), both.false_alarms) == (1, 3, 1)
    assert list(both.samples) == [20, 1]


def test_auc_is_the_share_of_pairs_in_order() -> None:
    assert auc(np.array([1.0, 2.0, 3.0, 4.0]), np.array([False, True, False, True])) == pytest.approx(0.75)
    assert auc(np.zeros(6), np.array([True, False] * 3)) == pytest.approx(0.5)


def test_episodes_join_alarms_up_to_a_second_apart() -> None:
    alarms = np.zeros(60, np.bool_)
    alarms[[5, 15, 30, 41]] = True
    assert episodes(alarms) == 3
    assert episodes(alarms[:5]) == 0


def test_the_gate_is_the_lowest_within_the_budget() -> None:
    statistic = np.zeros(3600)
    statistic[[100, 1000, 2000]] = (3.0, 5.0, 9.0)
    assert gate_for([statistic], 0.1, 10.0) == pytest.approx(5.0)
    assert gate_for([statistic], 0.1, 1.0) == pytest.approx(9.0)
