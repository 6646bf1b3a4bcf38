"""The dashboard asks for metrics that exist, and for all that the service tells."""

import json
import shutil
import subprocess
from pathlib import Path

import pytest
import yaml
from deploy.promql import asked, complaints

from headway.edge.telemetry.metrics import TABLE

FOLDER = Path(__file__).resolve().parents[2] / "deploy" / "grafana"
DASHBOARD = json.loads((FOLDER / "headway.json").read_text())
PANELS = [panel for panel in DASHBOARD["panels"] if panel["type"] != "row"]
QUERIES = [target["expr"] for panel in PANELS for target in panel["targets"]]


@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel["title"])
def test_a_panel_asks_for_what_exists(panel: dict) -> None:
    for target in panel["targets"]:
        assert asked(target["expr"])
        assert list(complaints(target["expr"])) == []


def test_every_metric_is_on_a_panel() -> None:
    shown = {name.removesuffix("_bucket") for query in QUERIES for name in asked(query)}
    assert {metric.name for metric in TABLE} <= shown


def test_variables_ask_for_labels_of_the_build() -> None:
    [build] = [metric for metric in TABLE if metric.name == "headway_build_info"]
    for variable in DASHBOARD["templating"]["list"]:
        if variable["type"] == "query":
            assert variable["query"]["query"].startswith("label_values(headway_build_info")
            assert variable["name"] in build.labels


def test_panels_have_a_place_of_their_own() -> None:
    taken: set[tuple[int, int]] = set()
    for panel in DASHBOARD["panels"]:
        place = panel["gridPos"]
        cells = {(place["x"] + i, place["y"] + j) for i in range(place["w"]) for j in range(place["h"])}
        assert not cells & taken
        assert all(x < 24 for x, _ in cells)
        taken |= cells
    assert len({panel["id"] for panel in DASHBOARD["panels"]}) == len(DASHBOARD["panels"])


def test_provisioning_names_the_source_that_the_dashboard_means() -> None:
    [source] = yaml.safe_load((FOLDER / "provisioning/datasources/prometheus.yml").read_text())["datasources"]
    [choice] = [variable for variable in DASHBOARD["templating"]["list"] if variable["type"] == "datasource"]
    assert (source["type"], source["uid"]) == (choice["query"], choice["current"]["value"])


@pytest.mark.skipif(shutil.which("promtool") is None, reason="promtool is not installed (Debian package prometheus)")
def test_prometheus_understands_every_query(tmp_path: Path) -> None:
    rules = [
        {"record": f"query:{n}", "expr": query.replace("$__rate_interval", "1m")} for n, query in enumerate(QUERIES)
    ]
    file = tmp_path / "rules.yml"
    file.write_text(yaml.safe_dump({"groups": [{"name": "queries", "rules": rules}]}))
    result = subprocess.run(["promtool", "check", "rules", file], capture_output=True, text=True, check=False)
    assert result.returncode == 0, result.stdout + result.stderr
