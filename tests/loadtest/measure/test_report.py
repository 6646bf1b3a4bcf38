import json
from dataclasses import replace

import pytest
from rich.console import Console

from headway_loadtest.inject.faults import BY_LABEL
from headway_loadtest.measure.accounting import Ledger
from headway_loadtest.measure.detection import KindScore, Quality
from headway_loadtest.measure.percentiles import Percentiles
from headway_loadtest.measure.report import MEANINGS, Targets, missed_targets, show, to_json
from headway_loadtest.measure.result import INTENDED, Outcome, Service

QUICK = Percentiles(1.0, 4.0, 6.0, 9.0, 1000)
SERVICE = Service(
    instance="i",
    ledger=Ledger(1000, 900, 95, {"duplicate": 5}, {}),
    stages={INTENDED: QUICK, "queue": QUICK},
    cpu_us=12.0,
    rss_mb=150.0,
    rss_warm_mb=149.0,
)
OUTCOME = Outcome(
    vehicles=10,
    seconds=10.0,
    warmup_s=2.0,
    speed=1.0,
    sent=1000,
    late=QUICK,
    stalled_s=0.0,
    generator_cpu_us=3.0,
    alert_latency=None,
    alerts=7,
    unread=0,
    quality=Quality({"bias": KindScore(4, 3, 2, 0.4)}, 3, 1, 0, 2, 0.5),
    service=SERVICE,
)


def with_ledger(*parts):
    return replace(OUTCOME, service=replace(SERVICE, ledger=Ledger(*parts)))


def printed(outcome):
    console = Console(width=110, record=True, quiet=True, force_terminal=False)
    console.quiet = False
    with console.capture() as capture:
        show(outcome, console)
    return capture.get()


def test_json_has_the_keys_that_scripts_depend_on():
    found = json.loads(json.dumps(to_json(OUTCOME, Targets())))
    assert found["sent"] == found["scored"] + found["warming"] + sum(found["rejected"].values()) + found["unaccounted"]
    assert found["offered_hz"] == 100.0
    assert found["latency_ms"] == {"p50": 1.0, "p99": 4.0, "p999": 6.0, "max": 9.0}
    assert set(found["stage_ms"]) == {INTENDED, "queue"}
    assert found["cpu_us_per_msg"] == {"service": 12.0, "generator": 3.0}
    assert (found["vehicles"], found["alerts"], found["rss_mb"]) == (10, 7, 150.0)
    assert found["detection"]["by_kind"]["bias"]["found"] == 3
    assert found["slo"]["ok"] is True


def test_a_bound_on_a_core_is_held_against_all_messages_of_a_second():
    assert missed_targets(OUTCOME, Targets(service_cpu_percent=0.13)) == []
    assert missed_targets(OUTCOME, Targets(service_cpu_percent=0.11)) == ["service CPU % of a core is 0.12, above 0.11"]


def test_json_of_a_run_that_nobody_heard():
    found = json.loads(json.dumps(to_json(replace(OUTCOME, service=None), Targets())))
    assert found["scored"] is None
    assert found["slo"] == {
        "ok": False,
        "missed": ["no service reported on this site"],
        "targets": dict.fromkeys(
            (
                "p50_ms",
                "p99_ms",
                "service_cpu_us",
                "service_cpu_percent",
                "rss_mb",
                "recovered_s",
                "surge_p99_ms",
                "rss_growth",
            )
        ),
    }


@pytest.mark.parametrize(
    ("outcome", "targets", "missed"),
    [
        (OUTCOME, Targets(), []),
        (OUTCOME, Targets(p50_ms=1.0, p99_ms=4.0, service_cpu_us=12.0, rss_mb=150.0), []),
        (OUTCOME, Targets(p99_ms=3.9), ["p99 ms is 4.00, above 3.9"]),
        (OUTCOME, Targets(service_cpu_us=11), ["service CPU us per message is 12.00, above 11"]),
        (with_ledger(1000, 900, 90, {}, {"shed": 10}), Targets(), ["10 messages lost (shed)"]),
        (with_ledger(1000, 900, 90, {}, {}), Targets(), ["10 messages unaccounted"]),
        (replace(OUTCOME, speed=2.0), Targets(p50_ms=1.0), ["p50 ms is not known"]),
        (replace(OUTCOME, service=None), Targets(), ["no service reported on this site"]),
    ],
)
def test_each_missed_target_is_a_sentence(outcome, targets, missed):
    assert missed_targets(outcome, targets) == missed


def test_the_report_is_for_everyone():
    text = printed(OUTCOME)
    for phrase in ("10 vehicles drove", "bias: readings are off by a constant", "False alarms: 1", "none unaccounted"):
        assert phrase in text
    for jargon in ("NIS", "Kalman", "covariance", "innovation"):
        assert jargon not in text


def test_the_report_says_what_went_wrong():
    assert "10 of 1,000 sent are unaccounted for" in printed(with_ledger(1000, 900, 90, {}, {}))
    assert "this service has other senders too" in printed(with_ledger(1000, 1010, 0, {}, {}))
    assert "No headway service reported" in printed(replace(OUTCOME, service=None))
    slow = replace(OUTCOME, late=Percentiles(1.0, 50.0, 60.0, 90.0, 1000), stalled_s=1.5)
    assert "generator itself was late: 99 % within 50.0 ms" in printed(slow)
    assert "held up for 1.5 s" in printed(slow)


def test_every_kind_has_a_meaning():
    assert set(MEANINGS) == set(BY_LABEL)
