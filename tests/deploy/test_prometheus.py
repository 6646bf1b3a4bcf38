"""The alert rules name what exists and what somebody can act on; `make check` runs promtool over them beside this."""

from pathlib import Path

import pytest
import yaml
from deploy.promql import asked, complaints
from fake_service import event

from headway.dashboard.event_summary import EventSummary
from headway.dashboard.notices import Notice, alertmanager_body
from headway.settings import Settings

FOLDER = Path(__file__).resolve().parents[2] / "deploy" / "prometheus"
RULES = [
    rule for group in yaml.safe_load((FOLDER / "headway.rules.yml").read_text())["groups"] for rule in group["rules"]
]


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule["alert"])
def test_a_rule_asks_for_what_exists(rule: dict) -> None:
    assert asked(rule["expr"])
    assert list(complaints(rule["expr"])) == []


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule["alert"])
def test_a_rule_says_how_bad_and_where_to_read_on(rule: dict) -> None:
    assert rule["labels"]["severity"] in {"critical", "warning", "info"}
    page = "https://headway.example/OPERATIONS.html"
    assert rule["annotations"]["runbook_url"] == f"{page}#{rule['alert'].lower()}"


def test_every_rule_is_shown_to_fire_and_to_hold_back() -> None:
    cases = [
        check
        for test in yaml.safe_load((FOLDER / "headway.rules.test.yml").read_text())["tests"]
        for check in test["alert_rule_test"]
    ]
    names = {rule["alert"] for rule in RULES}
    assert {case["alertname"] for case in cases if case["exp_alerts"]} == names
    assert {case["alertname"] for case in cases if not case["exp_alerts"]} == names


def test_alertmanager_groups_by_the_labels_that_the_dashboard_sends() -> None:
    config = yaml.safe_load((FOLDER.parent / "alertmanager" / "alertmanager.yml").read_text())
    summary = EventSummary.of(event(1))
    [sent] = alertmanager_body(Notice("local", "veh-0001", summary, summary.first_us), None)
    [route] = config["route"]["routes"]
    assert set(route["group_by"]) <= set(sent["labels"])
    assert f'alertname="{sent["labels"]["alertname"]}"' in route["matchers"]
    [inhibited] = config["inhibit_rules"]
    assert inhibited["source_matchers"] == route["matchers"]
    names = {rule["alert"] for rule in RULES}
    assert inhibited["target_matchers"][0] in {f'alertname="{name}"' for name in names}
    assert all(receiver["webhook_configs"][0]["send_resolved"] for receiver in config["receivers"])


def test_the_scrape_goes_to_the_port_of_the_service() -> None:
    config = yaml.safe_load((FOLDER / "prometheus.yml").read_text())
    [job] = config["scrape_configs"]
    [targets] = job["static_configs"]
    assert config["rule_files"] == ["headway.rules.yml"]
    assert job["job_name"] == "headway"
    assert all(target.endswith(f":{Settings().http_port}") for target in targets["targets"])


@pytest.mark.parametrize(
    ("expression", "complaint"),
    [
        ("rate(headway_recods_total[5m])", "no metric headway_recods_total"),
        ('headway_ready{outcome="scored"}', "headway_ready has no label outcome"),
        ('headway_records_total{outcome=~"scored|shedd"}', "outcome is never shedd"),
        ("sum by (stage) (headway_records_total)", "grouped by stage, which nothing here has"),
        ("headway_stage_latency_seconds > 1", "no metric headway_stage_latency_seconds"),
    ],
)
def test_the_test_of_expressions_finds_what_is_wrong(expression: str, complaint: str) -> None:
    assert list(complaints(expression)) == [complaint]
