"""The manifests: right by the schemas of Kubernetes, of one mind with each other and with the service."""

from collections.abc import Iterator
from pathlib import Path

import kubernetes_validate
import pytest
import yaml
import zenoh
from deploy.dockerfile import environment as image_environment
from deploy.manifest import ROOT, parse_command, require_confined, settings_of

from headway.settings import Settings

FOLDER = ROOT / "deploy" / "kubernetes"
VERSIONS = ("1.29", "1.37")
"""Oldest and newest that the manifests are held against."""
KUSTOMIZATION = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())
MANIFESTS = [
    manifest for name in KUSTOMIZATION["resources"] for manifest in yaml.safe_load_all((FOLDER / name).read_text())
]
WORKLOADS = [manifest for manifest in MANIFESTS if manifest["kind"] in {"StatefulSet", "Deployment"}]
[CONFIG] = [manifest["data"] for manifest in MANIFESTS if manifest["kind"] == "ConfigMap"]
[SERVICE] = [workload for workload in WORKLOADS if workload["kind"] == "StatefulSet"]


def named(manifest: dict) -> str:
    return f"{manifest['kind']} {manifest['metadata']['name']}"


def pod(workload: dict) -> dict:
    return workload["spec"]["template"]["spec"]


def container(workload: dict) -> dict:
    [only] = pod(workload)["containers"]
    return only


def environment(workload: dict) -> dict[str, str]:
    return {variable["name"]: variable["value"] for variable in container(workload).get("env", ())}


def selectors() -> Iterator[dict[str, str]]:
    for manifest in MANIFESTS:
        match manifest["kind"]:
            case "Service":
                yield manifest["spec"]["selector"]
            case "PodDisruptionBudget":
                yield manifest["spec"]["selector"]["matchLabels"]
            case "NetworkPolicy":
                yield manifest["spec"]["podSelector"]["matchLabels"]


@pytest.mark.parametrize("manifest", MANIFESTS, ids=named)
@pytest.mark.parametrize("version", VERSIONS)
def test_a_manifest_is_right_by_the_schema(manifest: dict, version: str) -> None:
    kubernetes_validate.validate(manifest, version, strict=True)


def test_the_schema_refuses_what_is_wrong() -> None:
    wrong = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "a"}, "dada": {}}
    with pytest.raises(kubernetes_validate.ValidationError):
        kubernetes_validate.validate(wrong, VERSIONS[-1], strict=True)


def test_every_file_is_applied_or_says_why_not() -> None:
    left_out = {file.name for file in FOLDER.glob("*.yaml")} - {*KUSTOMIZATION["resources"], "kustomization.yaml"}
    assert left_out == {"monitor.yaml"}


def test_selectors_find_pods() -> None:
    labels = [workload["spec"]["template"]["metadata"]["labels"] for workload in WORKLOADS]
    for selector in selectors():
        assert any(selector.items() <= of_pod.items() for of_pod in labels)
    for workload, of_pod in zip(WORKLOADS, labels, strict=True):
        assert workload["spec"]["selector"]["matchLabels"] == of_pod


def test_a_site_has_one_instance() -> None:
    assert SERVICE["spec"]["replicas"] == 1


@pytest.mark.parametrize("workload", WORKLOADS, ids=named)
def test_a_pod_is_confined(workload: dict) -> None:
    spec, only = pod(workload), container(workload)
    require_confined(spec, only)
    assert {"cpu", "memory"} == set(only["resources"]["limits"])


@pytest.mark.parametrize("workload", WORKLOADS, ids=named)
def test_what_a_pod_mounts_is_there(workload: dict) -> None:
    spec, only = pod(workload), container(workload)
    claims = [claim["metadata"]["name"] for claim in workload["spec"].get("volumeClaimTemplates", ())]
    volumes = {volume["name"]: volume for volume in spec["volumes"]} | {claim: {} for claim in claims}
    assert {mount["name"] for mount in only["volumeMounts"]} == set(volumes)
    assert "/tmp" in {mount["mountPath"] for mount in only["volumeMounts"]}
    for mount in only["volumeMounts"]:
        if "configMap" in volumes[mount["name"]]:
            assert mount["subPath"] in CONFIG


@pytest.mark.parametrize("workload", WORKLOADS, ids=named)
def test_the_command_line_knows_what_a_pod_runs(workload: dict) -> None:
    parse_command(container(workload)["args"])


@pytest.mark.parametrize("workload", WORKLOADS, ids=named)
def test_files_that_a_pod_is_told_of_are_mounted(workload: dict) -> None:
    places = [mount["mountPath"] for mount in container(workload)["volumeMounts"]]
    paths = [word.rpartition("=")[2] for word in container(workload)["args"]]
    for file in [word for word in paths if word.startswith("/")]:
        assert any(Path(file).is_relative_to(place) for place in places)


def test_the_service_starts_with_these_settings(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    file = tmp_path / "headway.toml"
    file.write_text(CONFIG["headway.toml"])
    settings = settings_of({**image_environment(), **environment(SERVICE)}, monkeypatch, file)
    places = {mount["mountPath"] for mount in container(SERVICE)["volumeMounts"]}
    assert {str(settings.zenoh_config), str(settings.state_dir), str(settings.snapshot_dir)} <= places
    [port] = container(SERVICE)["ports"]
    assert port["containerPort"] == settings.http_port
    assert pod(SERVICE)["terminationGracePeriodSeconds"] > settings.stop_timeout_s


def test_zenoh_takes_its_options_and_finds_the_certificates_mounted() -> None:
    config = zenoh.Config.from_json5(CONFIG["zenoh.json5"])
    shipped = zenoh.Config.from_file(ROOT / "deploy" / "zenoh" / "client.json5")
    assert config.get_json("scouting") == shipped.get_json("scouting")
    for workload in WORKLOADS:
        places = {mount["mountPath"] for mount in container(workload)["volumeMounts"]}
        for name in ("root_ca_certificate", "connect_private_key", "connect_certificate"):
            assert Path(config.get_json(f"transport/link/tls/{name}").strip('"')).parent.as_posix() in places


@pytest.mark.parametrize("probe", ["startupProbe", "livenessProbe", "readinessProbe"])
def test_probes_ask_what_the_service_answers(probe: str) -> None:
    asked = container(SERVICE)[probe]["httpGet"]
    assert asked == {"path": "/readyz" if probe == "readinessProbe" else "/livez", "port": "http"}


def test_the_network_lets_through_the_ports_that_are_used() -> None:
    opened = {
        port["port"]
        for manifest in MANIFESTS
        if manifest["kind"] == "NetworkPolicy"
        for rule in manifest["spec"].get("ingress", ())
        for port in rule["ports"]
    }
    assert opened == {port["containerPort"] for workload in WORKLOADS for port in container(workload)["ports"]}
    assert Settings().http_port in opened


def test_the_monitor_finds_the_service_and_names_its_job_as_the_rules_do() -> None:
    monitor = yaml.safe_load((FOLDER / "monitor.yaml").read_text())["spec"]
    [service] = [m for m in MANIFESTS if m["kind"] == "Service" and m["metadata"]["name"] == "headway"]
    assert monitor["selector"]["matchLabels"].items() <= service["metadata"]["labels"].items()
    assert service["metadata"]["labels"][monitor["jobLabel"]] == "headway"
    assert [endpoint["port"] for endpoint in monitor["endpoints"]] == [
        port["name"] for port in service["spec"]["ports"]
    ]
