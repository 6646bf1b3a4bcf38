"""The Ray cluster on Kubernetes: right by the schemas, and of one mind with the fleet."""

import shlex
from pathlib import Path

import kubernetes_validate
import pytest
import typer
import yaml
import zenoh
from deploy.manifest import ROOT, require_confined

from headway.cli import fleet
from headway.fleet.config import bus_options, read_config

FOLDER = ROOT / "deploy" / "kubernetes" / "fleet"
VERSIONS = ("1.29", "1.37")
KUSTOMIZATION = yaml.safe_load((FOLDER / "kustomization.yaml").read_text())
MANIFESTS = [
    manifest for name in KUSTOMIZATION["resources"] for manifest in yaml.safe_load_all((FOLDER / name).read_text())
]
[CLUSTER] = [manifest["spec"] for manifest in MANIFESTS if manifest["kind"] == "RayCluster"]
[CONFIG] = [manifest["data"] for manifest in MANIFESTS if manifest["kind"] == "ConfigMap"]
GROUPS = {"head": CLUSTER["headGroupSpec"], "workers": CLUSTER["workerGroupSpecs"][0]}


def container(group: str) -> dict:
    [only] = GROUPS[group]["template"]["spec"]["containers"]
    return only


@pytest.fixture
def config(tmp_path: Path):
    file = tmp_path / "fleet.toml"
    file.write_text(CONFIG["fleet.toml"])
    return read_config(file)


@pytest.mark.parametrize("version", VERSIONS)
def test_manifests_and_pods_are_right_by_the_schema(version: str) -> None:
    pods = [
        {"apiVersion": "v1", "kind": "PodTemplate", "metadata": {"name": name}, "template": group["template"]}
        for name, group in GROUPS.items()
    ]
    for manifest in [*(of for of in MANIFESTS if of["kind"] != "RayCluster"), *pods]:
        kubernetes_validate.validate(manifest, version, strict=True)


def test_every_file_is_applied() -> None:
    assert {file.name for file in FOLDER.glob("*.yaml")} == {*KUSTOMIZATION["resources"], "kustomization.yaml"}


def test_the_cluster_has_the_version_of_ray_that_is_installed() -> None:
    assert f"ray=={CLUSTER['rayVersion']}\n" in (ROOT / "constraints.txt").read_text()


@pytest.mark.parametrize("group", GROUPS)
def test_a_pod_is_confined_and_has_what_it_mounts(group: str) -> None:
    spec, only = GROUPS[group]["template"]["spec"], container(group)
    require_confined(spec, only)
    volumes = {volume["name"]: volume for volume in spec["volumes"]}
    assert {mount["name"] for mount in only["volumeMounts"]} == set(volumes)
    assert {"/tmp", "/dev/shm"} <= {mount["mountPath"] for mount in only["volumeMounts"]}
    assert all(mount["subPath"] in CONFIG for mount in only["volumeMounts"] if "subPath" in mount)
    port = GROUPS[group]["rayStartParams"]["object-manager-port"]
    assert all(port in only[probe]["exec"]["command"][-1] for probe in ("startupProbe", "livenessProbe"))


def test_the_head_starts_the_fleet_and_judges_nothing() -> None:
    assert GROUPS["head"]["rayStartParams"]["num-cpus"] == "0"
    script = container("head")["lifecycle"]["postStart"]["exec"]["command"][-1]
    command = shlex.split(script.removeprefix("until headway ").partition(";")[0])
    typer.main.get_command(fleet.app).commands[command[1]].make_context(command[1], command[2:])
    assert command[command.index("--config") + 1] in {mount["mountPath"] for mount in container("head")["volumeMounts"]}


def test_the_workers_have_room_for_all_sites_when_one_of_them_fails(config) -> None:
    workers = GROUPS["workers"]
    cpus = int(workers["rayStartParams"]["num-cpus"])
    assert str(cpus) == container("workers")["resources"]["requests"]["cpu"]
    rooms = (workers["replicas"] - 1) * (cpus / config.cpus - config.spares)
    assert len(config.sites) <= rooms


def test_the_state_is_on_the_volume_that_all_share(config) -> None:
    [claim] = [of["spec"] for of in MANIFESTS if of["kind"] == "PersistentVolumeClaim"]
    assert claim["accessModes"] == ["ReadWriteMany"]
    for group in GROUPS:
        [mount] = [of for of in container(group)["volumeMounts"] if of["name"] == "state"]
        assert mount["mountPath"] == str(config.state_dir)


def test_zenoh_takes_its_options_and_finds_the_certificates_mounted(config) -> None:
    options = zenoh.Config.from_json5(CONFIG["zenoh.json5"])
    places = {mount["mountPath"] for mount in container("workers")["volumeMounts"]}
    assert str(bus_options(config).zenoh_config) in places
    for name in ("root_ca_certificate", "connect_private_key", "connect_certificate"):
        assert Path(options.get_json(f"transport/link/tls/{name}").strip('"')).parent.as_posix() in places
