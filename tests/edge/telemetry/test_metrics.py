"""Metrics: one closed table, the same names from the first scrape on, and the values of the books."""

import numpy as np
import pytest
from edge.codec.messages import received, record
from edge.stub import StubEngine, event
from prometheus_client.parser import text_string_to_metric_families
from sim.clock import START_US
from sim.rig import Rig

from headway.core.types.batch import F64
from headway.core.types.outcome import Outcome
from headway.core.types.step_result import Phase, StepResult
from headway.edge.telemetry.accounting import KINDS, NIS_BAND, Ledger
from headway.edge.telemetry.latency import Iteration, Latencies
from headway.edge.telemetry.metrics import TABLE, Metrics, Type

OFFSET_US = 7_000_000


def scrape(rig: Rig) -> dict[tuple[str, ...], float]:
    """Values by name and label values, in the order of the labels' names."""
    return {
        (sample.name, *(value for _, value in sorted(sample.labels.items()))): sample.value
        for family in text_string_to_metric_families(Metrics(rig.context).text().decode())
        for sample in family.samples
    }


def test_the_table_is_what_is_told_beside_the_process() -> None:
    published = {
        family.name + ("_total" if family.type == "counter" else ""): (family.type, family.documentation)
        for family in text_string_to_metric_families(Metrics(Rig(StubEngine()).context).text().decode())
        if not family.name.startswith("process_")
    }
    assert published == {metric.name: (metric.type, metric.help) for metric in TABLE}


def test_names_carry_service_unit_and_type() -> None:
    for metric in TABLE:
        assert metric.name.startswith("headway_")
        assert metric.name.endswith("_total") == (metric.type is Type.COUNTER)
        assert metric.help.endswith((".", "consistent."))


def test_every_outcome_kind_and_phase_is_there_before_it_happens() -> None:
    values = scrape(Rig(StubEngine()))
    assert all(values["headway_records_total", outcome.label] == 0 for outcome in Outcome)
    assert all(values["headway_events_total", kind.label, phase] == 0 for kind in KINDS for phase in Phase)


def test_the_values_are_those_of_the_books() -> None:
    rig = Rig(StubEngine(vehicles=7))
    rig.engine.events = [event(), event(phase=Phase.CLEARED)]
    for sent in (received([record("a"), record("b")], "gw-1"), received(b"\xc1")):
        rig.bus.deliver(sent)
    rig.loop.iterate()
    values = scrape(rig)
    expected = {
        ("headway_messages_total",): 2,
        ("headway_records_total", "scored"): 2,
        ("headway_records_total", "malformed"): 1,
        ("headway_events_total", "bias", "onset"): 1,
        ("headway_events_total", "bias", "cleared"): 1,
        ("headway_vehicles",): 7,
        ("headway_ready",): 1,
        ("headway_nis_readings_total", "inside"): 2,
        ("headway_loop_iterations_total",): 1,
        ("headway_alarm_budget_per_hour",): 0.5,
        ("headway_build_info", "c0ffee", "i", "aekf", "s", "1"): 1,
    }
    assert {name: values[name] for name in expected} == expected


def test_the_share_inside_the_band_is_95_percent_of_a_consistent_filter() -> None:
    rng = np.random.default_rng(1)
    ledger = Ledger()
    nis = rng.chisquare(2, 100_000)
    ledger.record(0, [], StepResult(outcomes=np.zeros(nis.size, np.uint8), nis=nis), {})
    assert ledger.nis_inside / nis.size == pytest.approx(0.95, abs=0.005)
    assert ledger.nis_below / nis.size == pytest.approx(0.025, abs=0.004)
    assert ledger.nis_inside + ledger.nis_below + ledger.nis_above == nis.size
    assert pytest.approx((0.0506, 7.3778), abs=1e-4) == NIS_BAND


def iteration(waits_us: F64, decode_us: float = 0.0, detect_us: float = 0.0, publish_us: float = 0.0) -> Iteration:
    """An iteration whose records were sent and received so long before it."""
    received_us = START_US - waits_us.round().astype(np.int64)
    return Iteration(received_us, received_us + OFFSET_US, START_US, OFFSET_US, decode_us, detect_us, publish_us)


def test_a_histogram_counts_every_record_in_the_bucket_it_belongs_to() -> None:
    rig = Rig(StubEngine())
    waits_us = np.array([5.0, 50.0, 2e9])
    rig.latencies.record(iteration(waits_us, decode_us=100.0, detect_us=1_000.0, publish_us=10.0))
    rig.latencies.flush()
    values = scrape(rig)
    name = "headway_stage_latency_seconds"
    assert values[f"{name}_count", "queue"] == 3
    assert values[f"{name}_sum", "queue"] == pytest.approx(55e-6 + 2_000)
    queue = {float(key[1]): n for key, n in values.items() if (key[0], key[-1]) == (f"{name}_bucket", "queue")}
    assert (queue[1e-5], queue[1e-4], queue[100.0], queue[float("inf")]) == (1, 2, 2, 3)
    detect = {float(key[1]): n for key, n in values.items() if (key[0], key[-1]) == (f"{name}_bucket", "detect")}
    assert (detect[1e-4], detect[1e-3]) == (0, 3)
    assert (
        values[f"{name}_sum", "intended"] == values[f"{name}_sum", "total"] == pytest.approx(3 * 1.1e-3 + 2_000.000_055)
    )


def test_percentiles_are_right_to_a_twentieth_and_of_the_time_since_the_last_report() -> None:
    rng = np.random.default_rng(2)
    latencies = Latencies()
    sample_us = rng.lognormal(7.0, 1.0, 50_000).round()
    for part in np.array_split(sample_us, 100):
        latencies.record(iteration(part))
    published = latencies.percentiles_ms()
    exact = np.quantile(sample_us, [0.5, 0.99, 0.999]) / 1e3
    assert [published["p50"], published["p99"], published["p999"]] == pytest.approx(exact.tolist(), rel=0.06)
    assert published["max"] == pytest.approx(sample_us.max() / 1e3)
    assert latencies.percentiles_ms() == {}
